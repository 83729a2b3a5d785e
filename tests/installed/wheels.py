"""Install the wheels of a folder where nothing else is installed, use them, and compare bits: ``make test-wheels``.

    python -m tests.installed.wheels FOLDER [PYTHON ...]

Takes every Python from 3.11 on in the path, and each PYTHON: a command, which may run it under an emulator
("qemu-aarch64 -L root root/usr/bin/python3.13", "wine64 python.exe"). This machine's own get a fresh virtual
environment; for the others pip installs for their platform into a folder. `use.py` then runs there, and its results
must be those of this checkout.
"""

from __future__ import annotations

import json
import os
import shlex
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]

USE = (ROOT / "tests" / "installed" / "use.py", ROOT / "spec" / "vectors" / "manifest.json")

QUESTION = """
import json, sys, sysconfig
print(json.dumps([sysconfig.get_platform(), *sys.version_info[:2], sysconfig.get_config_var("Py_GIL_DISABLED") or 0]))
"""

SUMMARY = "{python}: {accept} vectors decoded, {reject} refused, {encoded} files written and read"

PIP = ("-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--only-binary", ":all:")


class Python:
    """An interpreter: the command that runs it, and the platform and version that it answers."""

    def __init__(self, command: list[str]) -> None:
        self.command = command
        platform, major, minor, without_lock = json.loads(output([*command, "-c", QUESTION]))
        self.platform: str = platform.replace("-", "_")
        self.version = (major, minor)
        self.abi = f"cp{major}{minor}{'t' * without_lock}"

    def wheel(self, folder: Path) -> Path | None:
        """Return the folder's wheel for this interpreter, or None."""
        system, _, processor = self.platform.partition("_")
        system = {"linux": "manylinux"}.get(system, system)
        kinds = [f"{self.abi}-{self.abi}", *([] if self.abi.endswith("t") else ["cp311-abi3"])]
        found = [path for kind in kinds for path in folder.glob(f"pdecodec-*-{kind}-{system}*{processor}.whl")]
        return found[0] if found else None

    def install(self, wheel: Path, folder: Path) -> list[str]:
        """Install a wheel with what it needs, and return the command that runs a Python which has it."""
        if len(self.command) == 1 and self.platform == sysconfig.get_platform().replace("-", "_"):
            output([*self.command, "-m", "venv", str(folder)])
            output([str(folder / "bin" / "python"), *PIP, str(wheel)])
            output([str(folder / "bin" / "pdecodec"), "formats"])
            return [str(folder / "bin" / "python")]
        tags = [self.platform]
        if self.platform.startswith("linux_"):
            processor = self.platform.removeprefix("linux_")
            tags = [*(f"manylinux_2_{minor}_{processor}" for minor in range(34, 16, -1)), f"manylinux2014_{processor}"]
        version = ".".join(map(str, self.version))
        chosen = [f"--platform={tag}" for tag in tags] + [f"--python-version={version}", "--implementation=cp"]
        abis = [f"--abi={abi}" for abi in (self.abi, *([] if self.abi.endswith("t") else ["abi3"]), "none")]
        output([sys.executable, *PIP, "--no-compile", f"--target={folder}", *chosen, *abis, str(wheel)])
        return self.command


def interpreters(named: list[str]) -> Iterator[Python]:
    for minor in range(11, 20):
        for name in (f"python3.{minor}", f"python3.{minor}t"):
            if shutil.which(name) and subprocess.run([name, "-V"], capture_output=True, check=False).returncode == 0:
                yield Python([name])
    for command in named:
        yield Python(shlex.split(command))


def output(command: list[str], **environment: str) -> str:
    quiet = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    result = subprocess.run(
        command, env=quiet | environment, cwd=tempfile.gettempdir(), capture_output=True, text=True, check=False
    )
    if result.returncode:
        sys.exit(f"{shlex.join(command)} failed\n{result.stdout[-2000:]}{result.stderr[-4000:]}")
    return result.stdout


def used(command: list[str], folder: Path, **environment: str) -> Any:
    return json.loads(output([*command, *map(str, USE), str(folder)], **environment))


def differences(found: Any, expected: Any) -> list[str]:
    return [
        f"{kind} {name}: {found['outcomes'][kind].get(name)}, not {outcome}"
        for kind, outcomes in expected["outcomes"].items()
        for name, outcome in outcomes.items()
        if found["outcomes"][kind].get(name) != outcome
    ]


def main(folder: Path, named: list[str]) -> None:
    with tempfile.TemporaryDirectory() as scratch:
        expected = used([sys.executable], Path(scratch, "here"))
        counts = {kind: len(outcomes) for kind, outcomes in expected["outcomes"].items()}
        failed = tried = False
        for number, python in enumerate(interpreters(named)):
            place = Path(scratch, str(number))
            wheel = python.wheel(folder)
            if wheel is None:
                print(f"{shlex.join(python.command)}: skipped, no wheel for {python.abi} on {python.platform}")
                continue
            command = python.install(wheel, place)
            found = used(command, place / "used", PYTHONPATH=str(place) if command == python.command else "")
            if not Path(found["package"]).is_relative_to(place):
                sys.exit(f"{shlex.join(command)} used {found['package']}")
            faults = differences(found, expected)
            failed |= bool(faults)
            tried = True
            summary = SUMMARY.format(python=found["python"], **counts)
            print(f"{wheel.name}, {summary}: {'OTHER BITS' if faults else 'same bits'}", *faults, sep="\n", flush=True)
    sys.exit(failed if tried else f"no Python here takes a wheel of {folder}")


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve(), sys.argv[2:])
