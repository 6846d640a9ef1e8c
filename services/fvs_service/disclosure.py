"""Strip folder paths from messages sent to clients."""

import re

_QUOTED = re.compile(r"""(['"`])/(?:[^'"`\n]*/)?([^'"`/\n]*)/?\1""")
_PLAIN = re.compile(r"(?<![\w:/.~-])(?!/v1/|/openapi)/(?:[^\s'\"`,;()]*/)?([^\s'\"`,;()/]+)/?")
_REST = re.compile(r"(?<![\w:/.~-])(?!v1/)(?:[^\s'\"`,;():/]+/){2,}([^\s'\"`,;()/]+)")
"""The rest of an unquoted path with spaces."""


def without_paths(sentence: str) -> str:
    """Replace the paths in a message of the engine or of a library by file names."""
    for pattern, name in ((_QUOTED, r"\1\2\1"), (_PLAIN, r"\1"), (_REST, r"\1")):
        sentence = pattern.sub(name, sentence)
    return sentence
