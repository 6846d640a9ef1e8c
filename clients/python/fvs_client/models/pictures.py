"""Images of the service in memory."""

import base64


class Png(bytes):
    """A PNG file as bytes; a notebook shows it."""

    __slots__ = ()

    def _repr_html_(self) -> str:
        return f'<img src="data:image/png;base64,{base64.b64encode(self).decode()}">'
