"""From answers to alarms: levels, the rule that raises alarms, and trees that know the answer "none"."""
