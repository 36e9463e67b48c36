"""Links to what lies beside `docs/`: Markdown, which pages of their own include here, and notebooks, copied here."""

from sphinx.application import Sphinx

_PAGES = {"../CONTRIBUTING.md": "contributing.md", "../CHANGELOG.md": "changes.md"}


def setup(app: Sphinx) -> dict[str, bool]:
    """Lead them to these pages."""
    app.connect("source-read", _redirect)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _redirect(app: Sphinx, page: str, source: list[str]) -> None:  # noqa: ARG001
    for outside, here in _PAGES.items():
        source[0] = source[0].replace(f"]({outside})", f"]({here})")
    to_docs = "../" * page.count("/")
    source[0] = source[0].replace(f"]({to_docs}../notebooks/", f"]({to_docs}notebooks/")
