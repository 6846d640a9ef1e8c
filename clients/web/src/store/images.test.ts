import { expect, it } from "vitest";
import type { SceneEvent } from "../api/events";
import type { Schemas } from "../api/service";
import { afterEvents } from "./images";

function image(number: number) {
  return { digest: `sha256:${number}`, number, registration: "pending" } as Schemas["Image"];
}

function event(kind: SceneEvent["kind"], data: Record<string, unknown>): SceneEvent {
  return { kind, data, scene_id: "scn_1", number: 1, created_at: "" };
}

it("adds, changes and removes images, in the order of arrival", () => {
  const now = afterEvents(
    [image(1), image(2), image(4)],
    [
      event("image.received", { ...image(3) }),
      event("image.excluded", { digest: "sha256:2", registration: "excluded" }),
      event("image.excluded", { digest: "sha256:9", registration: "excluded" }),
      event("image.deleted", { digest: "sha256:4" }),
    ],
  );
  expect(now.map((one) => [one.number, one.registration])).toEqual([
    [1, "pending"],
    [2, "excluded"],
    [3, "pending"],
  ]);
  expect(now[2]?.scene_id).toBe("scn_1");
});
