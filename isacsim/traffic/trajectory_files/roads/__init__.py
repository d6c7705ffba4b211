"""The lanes of a recording: between markings, of a Lanelet2 map, fitted to tracks, or those of a network."""
