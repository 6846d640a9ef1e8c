export const en = {
  cancel: "Cancel",
  close: "Close",
  imageFailed: "This image cannot be shown.",
  unknown: "–",
  units: {
    bytes: ["B", "kB", "MB", "GB", "TB"],
    seconds: (n: number) => `${n} s`,
    minutes: (n: number) => `${n} min`,
    hours: (hours: number, minutes: number) => `${hours} h ${String(minutes).padStart(2, "0")} min`,
    decibels: (n: string) => `${n} dB`,
    percent: (n: number) => `${n} %`,
  },
  ago: {
    now: "just now",
    minutes: (n: number) => `${n} min ago`,
    hours: (n: number) => `${n} h ago`,
  },
};
