"""The one error that a user can mend."""


class InputError(Exception):
    """The input or the arguments are wrong.

    The message is one line: what is wrong, where, and the mend. The command line prints it and exits with 2.
    """
