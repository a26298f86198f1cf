"""The command line: one module a group of verbs, each thin: read, call, show."""

INTERRUPTED = 130  # exit code after Ctrl-C: 128 and the number of SIGINT


def main() -> None:
    """Entry of the command; Ctrl-C ends it quietly, while its modules are being loaded, too."""
    try:
        from stagectl.cli.app import main as run

        run()
    except KeyboardInterrupt:
        raise SystemExit(INTERRUPTED) from None
    finally:
        # Where a string was interrupted that Python executes, as each import of a NamedTuple does, `python -m` ends by
        # the signal, whatever the exit code is.  The next string makes it forget.
        exec("")
