"""The closed loop as a Gymnasium environment: an agent decides which connected vehicles get which advisory.

In come settings and an agent's actions; out come observations, rewards and pictures of the road.

`isac_cosim.gym` registers it. Settings and observations are lowest, then the picture of the road, the traffic of one
environment, that traffic in a process of its own, and the environment that Gymnasium sees.
"""
