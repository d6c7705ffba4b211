"""The bundled scenarios, one folder each, and what their build scripts share."""
