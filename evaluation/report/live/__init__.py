"""The figures of an evaluation in running traffic."""
