"""The docs site: `make docs` builds it from this folder into `site/`; a warning is an error."""

import re
from importlib.metadata import version as version_of

from sphinx.application import Sphinx

project = "lostlink"
author = "The lostlink developers"
version = release = version_of("lostlink")

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
default_role = "code"

myst_heading_anchors = 4  # as forges have them: page.md#the-heading

autodoc_member_order = "bysource"
autodoc_default_options = {"inherited-members": "object, BaseException, tuple"}
autodoc_typehints_format = "short"
autodoc_type_aliases = {name: name for name in ("ArrayLike", "FloatArray")}
napoleon_attr_annotations = False  # the signature has the types

html_theme = "furo"
html_title = f"lostlink {version}"
html_copy_source = False
html_show_copyright = False


def plain(*event: object) -> tuple[object, ...] | None:
    """A signature with aliases by name; Sphinx 9.0 writes a wrapper of its own around those in a union."""
    if event[-2] is None:
        return None
    return tuple(part and re.sub(r"TypeAliasForwardRef\('(\w+)'\)", r"\1", str(part)) for part in event[-2:])


def setup(app: Sphinx) -> None:
    """Called by Sphinx."""
    app.connect("autodoc-process-signature", plain)
