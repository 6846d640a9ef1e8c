import { expect, it } from "vitest";
import { requestOf } from "./start-job";

function fields(values: Record<string, string>) {
  return (name: string) => values[name] ?? "";
}

it("leaves empty settings to the service", () => {
  expect(requestOf("update", fields({ iterations: " ", long_side_px: "" }))).toEqual({ kind: "update" });
});

it("holds images out of fine models only", () => {
  const given = fields({ iterations: "700", test_every: "8" });
  expect(requestOf("update", given)).toEqual({ kind: "update", iterations: 700 });
  expect(requestOf("fine", given)).toEqual({ kind: "fine", iterations: 700, test_every: 8 });
});
