"""What a dataset says of itself to people and catalogues: README.md for Hugging Face, and a Croissant description.

In come a finished dataset and what people state of it; out come both files.
"""
