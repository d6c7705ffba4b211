"""Commands that are not in `cosim.py`: each is a module, and `registration` adds them."""
