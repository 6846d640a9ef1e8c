import type { MapState } from "./map-state";
import type { Flat } from "./polygons";

const MOUSE_REACH_PX = 10;
const TOUCH_REACH_PX = 22;
/** A press that moves less than this is a click. */
const STILL_PX = 5;
const STEP_PX = 8;
const LARGE_STEP_PX = 60;

/** Let mouse, fingers and keys act on a map that is drawn in an element. Returns how to stop that. */
export function listen(element: HTMLElement, map: MapState): () => void {
  const pressed = new Map<number, Flat>();
  let start: Flat | null = null; // where a press began that may still be a click
  const placeOf = (event: MouseEvent): Flat => {
    const box = element.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };
  const reachOf = (event: PointerEvent) => (event.pointerType === "touch" ? TOUCH_REACH_PX : MOUSE_REACH_PX);

  const down = (event: PointerEvent) => {
    if (event.button !== 0) return;
    element.setPointerCapture(event.pointerId);
    const at = placeOf(event);
    pressed.set(event.pointerId, at);
    map.byKeys.value = false;
    if (pressed.size > 1) start = null;
    else if (map.hold(at, reachOf(event))) map.pointAt(at);
    else start = at;
  };
  const move = (event: PointerEvent) => {
    const at = placeOf(event);
    const before = pressed.get(event.pointerId);
    map.byKeys.value = false;
    map.pointAt(at);
    if (before === undefined || map.sketch.held.value) return;
    if (start && Math.hypot(at[0] - start[0], at[1] - start[1]) < STILL_PX) return;
    start = null;
    const other = [...pressed].find(([id]) => id !== event.pointerId)?.[1];
    if (other) pinch(map, before, at, other);
    else map.pan(at[0] - before[0], at[1] - before[1]);
    pressed.set(event.pointerId, at);
  };
  const up = (event: PointerEvent) => {
    const held = map.sketch.held.value !== null;
    if (!pressed.delete(event.pointerId)) return;
    if (held) map.sketch.drop();
    else if (start && event.type === "pointerup") map.click(start, reachOf(event));
    start = null;
    if (event.pointerType === "touch") map.pointer.value = null;
  };
  const leave = () => {
    if (!map.byKeys.value && !pressed.size) map.pointer.value = null;
  };
  const wheel = (event: WheelEvent) => {
    event.preventDefault();
    map.zoom(2 ** (-event.deltaY / (event.deltaMode === 0 ? 300 : 8)), placeOf(event));
  };
  const key = (event: KeyboardEvent) => {
    if (!event.ctrlKey && !event.metaKey && !event.altKey && press(map, event)) event.preventDefault();
  };
  element.addEventListener("pointerdown", down);
  element.addEventListener("pointermove", move);
  element.addEventListener("pointerup", up);
  element.addEventListener("pointercancel", up);
  element.addEventListener("pointerleave", leave);
  element.addEventListener("wheel", wheel, { passive: false });
  element.addEventListener("keydown", key);
  return () => {
    element.removeEventListener("pointerdown", down);
    element.removeEventListener("pointermove", move);
    element.removeEventListener("pointerup", up);
    element.removeEventListener("pointercancel", up);
    element.removeEventListener("pointerleave", leave);
    element.removeEventListener("wheel", wheel);
    element.removeEventListener("keydown", key);
  };
}

/** One of two fingers moved; the other stays. */
function pinch(map: MapState, before: Flat, after: Flat, other: Flat): void {
  const distance = (at: Flat) => Math.max(1, Math.hypot(at[0] - other[0], at[1] - other[1]));
  map.pan((after[0] - before[0]) / 2, (after[1] - before[1]) / 2);
  map.zoom(distance(after) / distance(before), [(after[0] + other[0]) / 2, (after[1] + other[1]) / 2]);
}

/** What a key does; false for keys that the map does not use. */
function press(map: MapState, { key, shiftKey }: KeyboardEvent): boolean {
  const step = shiftKey ? LARGE_STEP_PX : STEP_PX;
  const { sketch, pointer } = map;
  const at = pointer.value;
  switch (key) {
    case "ArrowLeft":
      map.movePointer(-step, 0);
      return true;
    case "ArrowRight":
      map.movePointer(step, 0);
      return true;
    case "ArrowUp":
      map.movePointer(0, -step);
      return true;
    case "ArrowDown":
      map.movePointer(0, step);
      return true;
    case "+":
    case "=":
      map.zoom(1.5, at ?? undefined);
      return true;
    case "-":
      map.zoom(1 / 1.5, at ?? undefined);
      return true;
    case "0":
      map.fit();
      return true;
    case "Enter":
      if (at === null) map.movePointer(0, 0);
      else if (sketch.held.value) sketch.drop();
      else if (!map.hold(at, MOUSE_REACH_PX)) map.click(at, MOUSE_REACH_PX);
      return true;
    case "Backspace":
    case "Delete":
      if (sketch.use.value) sketch.removeLast();
      else if (at) map.removeCorner(at, MOUSE_REACH_PX);
      return true;
    case "Escape":
      map.escape();
      return true;
    default:
      return false;
  }
}
