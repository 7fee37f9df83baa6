"""A controller as an FMU: its Python kernel traced on symbols and handed to the compiler."""
