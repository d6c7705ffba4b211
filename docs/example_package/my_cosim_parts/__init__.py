"""One part of each kind that can be added to isac-cosim, as docs/extending.md explains."""
