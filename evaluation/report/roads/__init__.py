"""Pictures of roads, with the sites beside them and the vehicles on them."""
