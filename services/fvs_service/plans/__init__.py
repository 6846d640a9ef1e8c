"""Plans of flights: which candidates to photograph next, in which order, and what they bring."""
