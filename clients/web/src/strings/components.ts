export const en = {
  cancel: "Cancel",
  close: "Close",
  imageFailed: "This image cannot be shown.",
  unknown: "–",
};
