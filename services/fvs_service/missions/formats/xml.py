"""Elements of KML and WPML."""

from xml.sax.saxutils import escape

KML = "http://www.opengis.net/kml/2.2"
HEAD = '<?xml version="1.0" encoding="UTF-8"?>\n'


def element(tag: str, *content: str | float) -> str:
    """An element: its content is elements, or one text or number."""
    inner = "".join(part if isinstance(part, str) else _number(part) for part in content)
    return f"<{tag}>{inner}</{tag}>"


def text(value: str) -> str:
    """A text as content."""
    return escape(value)


def _number(value: float) -> str:
    """A number without an exponent, which some readers reject; rounded to nine decimals."""
    digits = f"{value:.9f}".rstrip("0").rstrip(".")
    return "0" if digits == "-0" else digits
