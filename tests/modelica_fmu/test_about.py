"""An FMU says whose it is: version, author, licence, and the version's date, not the build's."""

from __future__ import annotations

import zipfile
from xml.etree import ElementTree

from modelica_fmu.about import about_text
from pyfmi_runner.build import build_fmu


def test_the_annotation_is_read_and_nothing_else() -> None:
    text = (
        'package P\n annotation(version = "1.2", versionDate = "2026-01-31",\n'
        '  __FMU(author = "A. B.", license = "MIT"));\nend P;'
    )
    assert about_text(text) == {
        "version": "1.2",
        "generationDateAndTime": "2026-01-31T00:00:00Z",
        "author": "A. B.",
        "license": "MIT",
    }
    assert about_text('model M "version = 1" end M;') == {}
    commented = '// annotation(version = "9", versionDate = "2020-01-01")'
    assert about_text(f'model M {commented}\n annotation(version = "3"); end M;') == {}


def test_the_gantry_s_fmu_says_whose_it_is_and_describes_its_speeds() -> None:
    with zipfile.ZipFile(build_fmu().path) as archive:
        root = ElementTree.fromstring(archive.read("modelDescription.xml"))
    for name in ("version", "author", "license", "copyright", "generationDateAndTime"):
        assert root.get(name), name
    described = {
        v.get("name"): v.get("description")
        for v in root.iter("ScalarVariable")
        if v.get("causality") in ("input", "output")
    }
    assert [name for name, text in described.items() if not text] == []
    assert "dz/dt" in str(described["v_z"])
