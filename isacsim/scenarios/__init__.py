"""Scenarios, read from SUMO's files or made from a map: road network, demand, sites. Knows nothing of motion."""
