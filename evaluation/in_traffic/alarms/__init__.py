"""From answers to alarms: levels, the rule that raises alarms, and trees that know the answer "none".

In come the answers to consecutive windows; out come alarms, each with vehicle, intention and time.
"""
