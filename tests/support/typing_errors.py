"""Compare pyright's errors in src with the number in rooms.toml, which may only fall: ``python -m tests.support.typing_errors``."""

import json
import subprocess
import sys
import tomllib

from tests.support.rooms import BUDGETS, ROOT

COMMAND = [sys.executable, "-m", "pyright", "--outputjson", "--pythonpath", sys.executable, "src"]


def find_errors() -> list[str]:
    """Get a line for each error: file, line, message."""
    report = json.loads(subprocess.run(COMMAND, check=False, cwd=ROOT, capture_output=True, text=True).stdout)
    return [
        f"{found['file'].removeprefix(f'{ROOT}/')}:{found['range']['start']['line'] + 1}: {found['message']}"
        for found in report["generalDiagnostics"]
        if found["severity"] == "error"
    ]


def main() -> None:
    """Print the number of errors; where it is above the allowed one, print the errors and end with 1."""
    allowed = tomllib.loads(BUDGETS.read_text(encoding="utf-8"))["types"]["pyright"]
    errors = find_errors()
    print(f"{len(errors)} of {allowed} errors of pyright in src")
    if len(errors) > allowed:
        sys.exit("\n".join([*errors, f"rooms.toml allows {allowed}"]))


if __name__ == "__main__":
    main()
