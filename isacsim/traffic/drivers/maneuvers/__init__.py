"""What the director can make happen, one kind a file: its settings, how it is drawn, and how it is driven.

In come settings and a random stream; out come maneuvers and causes, each with its time and whoever carries it out.
"""
