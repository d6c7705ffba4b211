"""The lanes of a recording: between markings, of a Lanelet2 map, fitted to tracks, or those of a network.

In come markings, maps and positions; out come lanes, and which of them each position is in.
"""
