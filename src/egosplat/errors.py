"""The one exception that means: the user can mend this."""


class UserError(Exception):
    """A mistake in the input, the configuration or the environment, told in one or two lines.

    The message names the file or key, what is wrong with it, and what to do. The command line
    prints it without a traceback and exits with status 2. Programming errors are never wrapped in it.
    """
