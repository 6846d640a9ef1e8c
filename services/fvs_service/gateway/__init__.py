"""What both transports share: connections, keys, limits, conversion, errors."""
