import { expect, it } from "vitest";
import type { Schemas } from "../api/service";
import { countsOf, filtered } from "./filters";

function image(name: string, more: Partial<Schemas["Image"]>): Schemas["Image"] {
  return { name, verdict: "accepted", warnings: [], ...more } as Schemas["Image"];
}

const IMAGES = [
  image("A.jpg", { registration: "registered" }),
  image("b.jpg", { registration: "registered", warnings: ["blurred"] }),
  image("c.jpg", { registration: "pending" }),
  image("d.jpg", { registration: "unregistered" }),
  image("e.jpg", { registration: "excluded" }),
  image("f.jpg", { registration: "quarantined" }),
  image("g.jpg", { registration: "unused", verdict: "too-small" }),
  image("h.mp4", { registration: "unused", verdict: "video" }),
];

it("counts what each filter shows", () => {
  expect(countsOf(IMAGES)).toEqual({
    all: 8,
    problems: 4,
    pending: 1,
    registered: 2,
    unregistered: 1,
    excluded: 2,
  });
});

it("searches within a filter", () => {
  expect(filtered(IMAGES, "registered", " a.J").map((one) => one.name)).toEqual(["A.jpg"]);
  expect(filtered(IMAGES, "problems", "").map((one) => one.name)).toEqual([
    "b.jpg",
    "d.jpg",
    "f.jpg",
    "g.jpg",
  ]);
});
