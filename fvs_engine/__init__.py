"""The science of next-view selection: photographs in, splats and ranked next views out.

A plain library: no web, no database, no queue. See ``docs/conventions.md`` for frames, units and names.
"""
