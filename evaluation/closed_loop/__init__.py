"""The closed loop: a predictor's alarms become advisories to connected vehicles in running traffic, and their effect on
safety and efficiency is measured. It does not know how a predictor is trained or how its alarms are chosen.

In come a run, the alarms chosen for it and a scenario; out come the figures of each arm, and differences between arms.
"""
