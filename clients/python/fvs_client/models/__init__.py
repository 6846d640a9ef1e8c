"""Immutable, typed data of requests and answers, in the service's terms and units."""
