"""README and the pages it names show the tools and the clients that there are."""

from __future__ import annotations

import re
from pathlib import Path

from atw_mcp.client_configuration import FORMS
from tests.atw_mcp.tools.tools_page import PAGE, with_table

ROOT = Path(__file__).parents[3]
TEXT = (ROOT / "README.md").read_text(encoding="utf-8")


def test_table_of_tools_is_that_of_the_manifest() -> None:
    text = PAGE.read_text(encoding="utf-8")
    assert with_table(text) == text, "run python -m tests.atw_mcp.tools.contract_snapshots"


def test_every_client_is_named() -> None:
    section = TEXT[TEXT.index("## Use it from an agent") : TEXT.index("## Read on")]
    assert [client for client in FORMS if f"`{client}`" not in section] == []


def test_every_link_leads_to_a_file() -> None:
    pages = [ROOT / "README.md", *(ROOT / ".docs" / "pages").glob("*.md")]
    links = [(page, link) for page in pages for link in re.findall(r"\]\(([^):]+)\)", page.read_text("utf-8"))]
    assert len(links) > 15
    assert [(page.name, link) for page, link in links if not (page.parent / link).exists()] == []


def test_the_site_holds_every_page() -> None:
    listed = re.findall(r"^  - (\S+\.md)$", (ROOT / ".docs" / "mkdocs.yml").read_text("utf-8"), re.MULTILINE)
    assert sorted(listed) == sorted(page.name for page in (ROOT / ".docs" / "pages").glob("*.md"))


def test_the_readme_is_read_in_a_few_minutes() -> None:
    assert len(TEXT.split()) <= 900
