import { type Schemas, send } from "../api/service";
import { type MissionCall, type MissionForm, type MissionMaterial, missionCall } from "./mission-form";

/** A view that a mission leaves out, and why; the service gives the first reasons only. */
export interface LeftOut {
  id: string;
  reason: string;
}

/** A file of a mission, the whole one or a part that one battery flies; poses have no route. */
export interface MissionPart {
  name: string;
  content: Blob;
  parts: number;
  route: Route | null;
  /** The request for its picture to brief a pilot; poses have none. */
  briefing: MissionCall | null;
  leftOut: readonly LeftOut[];
}

export interface Route {
  views: number;
  length_m: number;
  duration_s: number;
}

/** All files of a mission, in order: those of each vehicle of a plan. Throws `ServiceError` and `FormError`. */
export async function missionParts(
  form: MissionForm,
  material: MissionMaterial,
  signal: AbortSignal,
): Promise<MissionPart[]> {
  const vehicles = form.source === "plan" && form.vehicle === "" ? flying(material.plan) : [];
  if (vehicles.length < 2)
    return partsOfOne({ ...form, vehicle: vehicles[0] ?? form.vehicle }, material, signal);
  const files: MissionPart[] = [];
  for (const vehicle of vehicles) {
    const parts = await partsOfOne({ ...form, vehicle }, material, signal);
    files.push(...parts.map((part) => ({ ...part, name: `vehicle-${vehicle}-${part.name}` })));
  }
  return files;
}

/** The numbers of the vehicles that a plan needs. */
export function flying(plan: Schemas["Plan"] | null): string[] {
  const tours = plan?.tours.filter(({ stops }) => stops.length > 0) ?? [];
  return tours.map(({ vehicle }) => String(vehicle));
}

/** The views that files leave out, each once. */
export function allLeftOut(files: readonly MissionPart[]): LeftOut[] {
  const byId = new Map(files.flatMap(({ leftOut }) => leftOut).map((one) => [one.id, one]));
  return [...byId.values()];
}

async function partsOfOne(
  form: MissionForm,
  material: MissionMaterial,
  signal: AbortSignal,
): Promise<MissionPart[]> {
  const parts: MissionPart[] = [];
  for (let part = 1; part <= (parts[0]?.parts ?? 1); part++) {
    const file = await missionPart(missionCall(form, material, part), signal);
    const briefing = file.route && missionCall({ ...form, format: "briefing" }, material, part);
    parts.push({ ...file, briefing });
  }
  return parts;
}

/** The picture of a part, which the pilot is briefed with. Throws `ServiceError`. */
export async function briefingOf(call: MissionCall, name: string): Promise<{ name: string; content: Blob }> {
  const { content } = await missionPart(call, new AbortController().signal);
  return { name: `${name.replace(/\.[^.]+$/, "")}.briefing.svg`, content };
}

async function missionPart(call: MissionCall, signal: AbortSignal): Promise<Omit<MissionPart, "briefing">> {
  const response = await send(call.path, {
    signal,
    ...(call.body && {
      method: "POST",
      headers: { "Content-Type": "application/json" },
      body: JSON.stringify(call.body),
    }),
  });
  const { headers } = response;
  return {
    name: fileName(headers.get("Content-Disposition")),
    content: await response.blob(),
    parts: Number(headers.get("Mission-Parts") ?? 1),
    route: routeOf(headers),
    leftOut: leftOutOf(headers),
  };
}

/** The name of a file in a header; `mission` where there is none. */
export function fileName(disposition: string | null): string {
  return /filename="([^"]+)"/.exec(disposition ?? "")?.[1] ?? "mission";
}

/** What headers say of the flight; null for poses. */
export function routeOf(headers: Headers): Route | null {
  const duration = headers.get("Mission-Duration-S");
  if (duration === null) return null;
  const [views, length_m] = [headers.get("Mission-Views"), headers.get("Mission-Length-M")].map(Number);
  return { views: views ?? 0, length_m: length_m ?? 0, duration_s: Number(duration) };
}

/** The views that headers name as left out. */
export function leftOutOf(headers: Headers): LeftOut[] {
  const ids = headers.get("Left-Out")?.split(",") ?? [];
  const reasons = JSON.parse(headers.get("Left-Out-Reasons") ?? "[]") as string[];
  return ids.map((id, index) => ({ id, reason: reasons[index] ?? "" }));
}
