"""The errors a user can cause. Each names what was found, where, and what is allowed."""


class PolymapError(Exception):
    """Base of every error that the commands print as one line and turn into exit status 2."""


class UsageError(PolymapError):
    """A command was called in a way that cannot work."""


class ParameterError(PolymapError):
    """A parameter has an unknown name, a wrong type or a value that is not allowed.

    Parameters
    ----------
    name : str
        Full name, such as ``grid.range_step_m``.
    problem : str
        What was found and what is allowed.
    """

    def __init__(self, name: str, problem: str) -> None:
        super().__init__(f'parameter {name}: {problem}')
        self.name = name
        self.problem = problem

    def __reduce__(self) -> tuple[type['ParameterError'], tuple[str, str]]:
        """Pickle by what it was made of, so that it can come from another process."""
        return type(self), (self.name, self.problem)


class RecordingError(PolymapError):
    """A recording cannot be read, or holds no usable topic."""


class SceneError(PolymapError):
    """A scene to simulate is unknown, malformed or impossible."""


class StateError(PolymapError):
    """A saved state cannot be continued."""


class BadOdometry(PolymapError):
    """One odometry message cannot be used; it is dropped and counted, never fatal."""


class BadPing(PolymapError):
    """One ping cannot be used; it is dropped and counted, never fatal.

    Parameters
    ----------
    reason : str
        One of the drop reasons of the diagnostics, such as ``bad_samples``.
    text : str
        The sentence for the log.
    """

    def __init__(self, reason: str, text: str) -> None:
        super().__init__(text)
        self.reason = reason

    def __reduce__(self) -> tuple[type['BadPing'], tuple[str, str]]:
        """Pickle by what it was made of, so that it can come from another process."""
        return type(self), (self.reason, str(self))
