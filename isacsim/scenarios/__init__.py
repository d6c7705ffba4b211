"""Scenarios, read from SUMO's files or made from a map: road network, demand, sites. Knows nothing of motion.

In come SUMO's files, or a map; out comes a `Scenario`, with its lanes, its sites and what SUMO is given.
"""
