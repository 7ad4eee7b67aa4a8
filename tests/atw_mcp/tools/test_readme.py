"""The README shows the tools there are, and configurations as they are printed."""

from __future__ import annotations

import json
import re

from atw_mcp.client_configuration import FORMS, NAME, configuration
from tests.atw_mcp.tools.readme_table import README, with_table

TEXT = README.read_text(encoding="utf-8")


def test_table_of_tools_is_that_of_the_manifest() -> None:
    assert with_table(TEXT) == TEXT, "run python -m tests.atw_mcp.tools.contract_snapshots"


def test_every_client_is_named_with_its_file() -> None:
    for client, form in FORMS.items():
        assert f"`atw-mcp config {client}`" in TEXT
        assert form.title in TEXT


def test_configurations_shown_have_the_form_that_is_printed() -> None:
    shown = [json.loads(block) for block in re.findall(r"```json\n(.*?)```", TEXT, re.DOTALL) if f'"{NAME}"' in block]
    printed = [configuration(client) for client in FORMS]
    assert len(shown) == 2
    for block in shown:
        key = next(iter(block))
        like = [form[key][NAME] for form in printed if key in form]
        assert any(set(block[key][NAME]) == set(entry) for entry in like)
