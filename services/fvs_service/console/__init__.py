"""The operator's console: a page of the browser, built from ``clients/web``."""
