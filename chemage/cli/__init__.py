"""The command line."""

import os


def main() -> None:
    """Run the command line; an interruption while it is loaded is one line as well."""
    try:
        from chemage.cli import app
    except KeyboardInterrupt:
        os.write(2, b"\ninterrupted; nothing was written\n")
        os._exit(130)
    app.main()
