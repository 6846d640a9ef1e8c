"""Plans: which views to visit, and in which order, so that the model knows all of its targets well.

Nothing is rendered: a plan follows from poses alone (and, where poses are estimated, from sparse points).
"""
