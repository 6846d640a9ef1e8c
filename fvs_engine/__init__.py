"""The engine of next-view selection: structure from motion, Gaussian splats, rankings, the selection loop.

A library: no web server, no service database, no queue. See ``docs/conventions.md`` for frames, units and
names.
"""
