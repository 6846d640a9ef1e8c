import type { Triple } from "../api/artifacts";
import { add, times } from "../geometry/vectors";
import type { Lens } from "./lens";
import { move, orbit, turn, type Viewpoint, zoom } from "./viewpoint";

/** What navigation asks of the view. */
export interface Navigated {
  readonly view: Viewpoint;
  readonly up: Triple;
  readonly lens: Lens;
  /** The radius of what is shown, for the speed of flight. */
  readonly radius: number;
  /** Show another viewpoint; the operator moves it. */
  navigate(view: Viewpoint): void;
  hover(at: readonly [number, number] | null): void;
  click(at: readonly [number, number]): void;
  /** A key that is no navigation; returns whether it was used. */
  command(key: string): boolean;
}

const RADIANS_PER_PX = 0.006;
const KEY_STEP = 0.08;
const CLICK_PX = 5;
const FLIGHT: Record<string, Triple> = {
  w: [0, 0, 1],
  s: [0, 0, -1],
  a: [-1, 0, 0],
  d: [1, 0, 0],
};
const ARROWS: Record<string, readonly [number, number]> = {
  ArrowLeft: [-1, 0],
  ArrowRight: [1, 0],
  ArrowUp: [0, -1],
  ArrowDown: [0, 1],
};

/** Mouse, touch and keys of an element as movements of a view. */
export class Navigation {
  private readonly aborter = new AbortController();
  private readonly pointers = new Map<number, readonly [number, number]>();
  private readonly held = new Set<string>();
  private travelled = 0;
  private flying = 0;

  constructor(
    private readonly element: HTMLElement,
    private readonly of: Navigated,
  ) {
    const options = { signal: this.aborter.signal };
    element.addEventListener("pointerdown", (event) => this.press(event), options);
    element.addEventListener("pointermove", (event) => this.drag(event), options);
    element.addEventListener("pointerup", (event) => this.release(event), options);
    element.addEventListener("pointercancel", (event) => this.pointers.delete(event.pointerId), options);
    element.addEventListener("pointerleave", () => of.hover(null), options);
    element.addEventListener("contextmenu", (event) => event.preventDefault(), options);
    element.addEventListener("wheel", (event) => this.wheel(event), { ...options, passive: false });
    element.addEventListener("keydown", (event) => this.keydown(event), options);
    element.addEventListener("keyup", (event) => this.held.delete(event.key.toLowerCase()), options);
    element.addEventListener("blur", () => this.held.clear(), options);
  }

  dispose(): void {
    this.aborter.abort();
    cancelAnimationFrame(this.flying);
  }

  private place(event: MouseEvent): readonly [number, number] {
    const box = this.element.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  }

  private press(event: PointerEvent): void {
    this.element.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, this.place(event));
    this.travelled = this.pointers.size > 1 ? CLICK_PX : 0;
  }

  private drag(event: PointerEvent): void {
    const before = this.pointers.get(event.pointerId);
    const now = this.place(event);
    if (!before) {
      this.of.hover(now);
      return;
    }
    const [dx, dy] = [now[0] - before[0], now[1] - before[1]];
    this.travelled += Math.abs(dx) + Math.abs(dy);
    this.pointers.set(event.pointerId, now);
    if (this.travelled < CLICK_PX) return;
    if (this.pointers.size > 1) this.pinch(event.pointerId, before, now);
    else if (event.shiftKey || (event.buttons & 6) !== 0) this.pan(dx, dy);
    else if (event.altKey || event.ctrlKey) this.of.navigate(this.turned(-dx, -dy));
    else this.of.navigate(orbit(this.of.view, -dx * RADIANS_PER_PX, -dy * RADIANS_PER_PX, this.of.up));
  }

  private turned(dx: number, dy: number): Viewpoint {
    const { view, lens, up } = this.of;
    return turn(view, dx / lens.fx, -dy / lens.fy, up);
  }

  private pinch(id: number, before: readonly [number, number], now: readonly [number, number]): void {
    const other = [...this.pointers].find(([one]) => one !== id)?.[1];
    if (!other) return;
    const apart = (at: readonly [number, number]) => Math.hypot(at[0] - other[0], at[1] - other[1]) + 1;
    this.pan((now[0] - before[0]) / 2, (now[1] - before[1]) / 2);
    this.of.navigate(zoom(this.of.view, apart(before) / apart(now)));
  }

  private pan(dx: number, dy: number): void {
    const { view, lens } = this.of;
    this.of.navigate(move(view, [(-dx * view.distance) / lens.fx, (-dy * view.distance) / lens.fy, 0]));
  }

  private release(event: PointerEvent): void {
    const clicked = this.pointers.size === 1 && this.travelled < CLICK_PX && event.button === 0;
    this.pointers.delete(event.pointerId);
    if (clicked) this.of.click(this.place(event));
  }

  private wheel(event: WheelEvent): void {
    event.preventDefault();
    const lines = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? event.deltaY * 30 : event.deltaY;
    this.of.navigate(zoom(this.of.view, Math.exp(Math.max(-300, Math.min(300, lines)) * 0.0015)));
  }

  private keydown(event: KeyboardEvent): void {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const { view, up } = this.of;
    const arrow = ARROWS[event.key];
    const key = event.key.toLowerCase();
    if (arrow && event.shiftKey) this.pan(-arrow[0] * 30, -arrow[1] * 30);
    else if (arrow) this.of.navigate(orbit(view, -arrow[0] * KEY_STEP, arrow[1] * KEY_STEP, up));
    else if (key === "+" || key === "=") this.of.navigate(zoom(view, 0.85));
    else if (key === "-") this.of.navigate(zoom(view, 1 / 0.85));
    else if ("wasdqe".includes(key) && key.length === 1) {
      this.held.add(key);
      this.fly();
    } else if (!this.of.command(event.key)) return;
    event.preventDefault();
  }

  /** Fly as long as keys are held, at the speed of half of what is shown in a second. */
  private fly(): void {
    if (this.flying) return;
    let last = performance.now();
    const step = (now: number) => {
      this.flying = this.held.size ? requestAnimationFrame(step) : 0;
      const length = this.of.radius * 0.5 * Math.min(0.1, Math.max(0, now - last) / 1000);
      last = now;
      let view = this.of.view;
      for (const key of this.held) {
        const along = FLIGHT[key];
        if (along) view = move(view, times(along, length));
        else
          view = { ...view, position: add(view.position, times(this.of.up, key === "e" ? length : -length)) };
      }
      if (this.held.size) this.of.navigate(view);
    };
    this.flying = requestAnimationFrame(step);
  }
}
