"""Documents that are mailed do not tell of the folders of the machine that they were written on."""

from __future__ import annotations

import pytest

from atw_mcp.viewer.paths import without_folders


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("case a (World Modeling): video /home/ada/my clips/a.mp4", "case a (World Modeling): video a.mp4"),
        ("/home/ada/a.mp4 is not where it was", "a.mp4 is not where it was"),
        (r"read C:\clips\b.csv, C:\my clips\c.csv", "read b.csv, c.csv"),
        ("3 m/s, kg/m/s and 1/2; either/or", "3 m/s, kg/m/s and 1/2; either/or"),
        ("atw://case/a/b and https://a.org/b/c", "atw://case/a/b and https://a.org/b/c"),
    ],
)
def test_paths_become_names_of_files(text: str, shown: str) -> None:
    assert without_folders(text, ["/home/ada/my clips/a.mp4", r"C:\my clips\c.csv", "a"]) == shown
