"""Makes the pictures that are taken of results: `python docs/pictures.py [NAME ...]` runs the
command beside each in a folder of its own and keeps the picture in docs/images. Needs Chromium for
a page.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
IMAGES = ROOT / "docs" / "images"
PICTURES = {  # name: the command, and what it writes
    "tracking.png": (
        "run --workpiece incline_16 --set contact.K_c=2e4 --seed 3 --plot run.png",
        "run.png",
    ),
    "diagnosis.png": ("demo", "out/demo/report.html"),
}
SIZE = (1100, 1600)  # pixels of a page that are kept: verdict, where, which, how far


def shoot(page: Path, picture: Path, size: tuple[int, int] = SIZE, dark: bool = False) -> None:
    """A page's top as a picture. Raises FileNotFoundError without Chromium, CalledProcessError
    where it fails.
    """
    browser = shutil.which("chromium") or shutil.which("chromium-browser")
    if browser is None:
        raise FileNotFoundError("no Chromium on PATH (apt-get install chromium)")
    flags = ["--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars"]
    flags += [f"--window-size={size[0]},{size[1]}", "--virtual-time-budget=4000"]
    flags += ["--blink-settings=preferredColorScheme=0"] if dark else []
    command = [browser, *flags, f"--screenshot={picture}", page.resolve().as_uri()]
    subprocess.run(command, check=True, capture_output=True)


def make(name: str) -> None:
    """Runs a picture's command and keeps the picture."""
    command, made = PICTURES[name]
    with tempfile.TemporaryDirectory() as folder:
        run = [sys.executable, "-m", "pneugantry", *command.split()]
        own = os.environ | {"PYTHONPATH": str(ROOT)}
        subprocess.run(run, cwd=folder, env=own, check=True)
        source = Path(folder) / made
        if source.suffix == ".html":
            shoot(source, IMAGES / name)
        else:
            shutil.copyfile(source, IMAGES / name)


if __name__ == "__main__":
    for chosen in sys.argv[1:] or PICTURES:
        make(chosen)
