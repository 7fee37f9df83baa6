"""Where a missing term may enter: equations of a model, as text and by the compiler."""
