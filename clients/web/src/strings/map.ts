export const en = {
  notAligned:
    "The model is not aligned with Earth yet, so nothing drawn on the map has a place in it. It is aligned when three photographs with positions are registered.",
};
