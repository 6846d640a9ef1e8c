"""The nouns on the wire: what the service and its clients send each other, as immutable records."""
