"""What a dataset says of itself to people and catalogues: README.md for Hugging Face, and a Croissant description."""
