"""XML as text, without a tree."""

from xml.sax.saxutils import escape


def element(tag: str, *content: str | float) -> str:
    """An element: its content is elements, or one text or number."""
    inner = "".join(part if isinstance(part, str) else f"{part:.10g}" for part in content)
    return f"<{tag}>{inner}</{tag}>"


def text(value: str) -> str:
    """A text as content."""
    return escape(value)
