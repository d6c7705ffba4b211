"""The measurements behind the documents: run by hand, and not shipped."""
