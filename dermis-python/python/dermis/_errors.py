"""The error of the package."""


class DermisError(ValueError):
    """Input that cannot be used, or a problem without a solution.

    Attributes:
        message: What is wrong.
        hint: The fix, or None.
        line: The line in the design file, or None.
        field: The key in the design file, or None.
    """

    message: str
    hint: str | None
    line: int | None
    field: str | None

    def __init__(
        self, message: str, *, hint: str | None = None, line: int | None = None, field: str | None = None
    ) -> None:
        super().__init__(message if hint is None else f"{message} ({hint})")
        self.message = message
        self.hint = hint
        self.line = line
        self.field = field
