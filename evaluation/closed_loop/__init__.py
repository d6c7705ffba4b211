"""The closed loop: a predictor's alarms become advisories to connected vehicles in running traffic, and their effect on
safety and efficiency is measured. It does not know how a predictor is trained or how its alarms are chosen.
"""
