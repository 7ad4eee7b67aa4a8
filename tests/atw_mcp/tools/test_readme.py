"""The README shows the tools and the clients that there are."""

from __future__ import annotations

from atw_mcp.client_configuration import FORMS
from tests.atw_mcp.tools.readme_table import README, with_table

TEXT = README.read_text(encoding="utf-8")


def test_table_of_tools_is_that_of_the_manifest() -> None:
    assert with_table(TEXT) == TEXT, "run python -m tests.atw_mcp.tools.contract_snapshots"


def test_every_client_is_named() -> None:
    section = TEXT[TEXT.index("## Use it from an agent") : TEXT.index("## The tools")]
    assert [client for client in FORMS if f"`{client}`" not in section] == []
