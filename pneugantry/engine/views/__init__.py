"""Parts of the model cut at what is measured, and their simulation over records."""
