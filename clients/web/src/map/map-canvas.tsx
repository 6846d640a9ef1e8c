import { effect } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { strings } from "../strings";
import { listen } from "./gestures";
import type { MapState } from "./map-state";
import { paintMap } from "./paint";

/** The map as a picture that mouse, fingers and keys act on. */
export function MapCanvas({ map }: { map: MapState }) {
  const element = useRef<HTMLCanvasElement>(null);
  useEffect(() => {
    const canvas = element.current as HTMLCanvasElement;
    const area = canvas.parentElement as HTMLElement;
    const measure = () => {
      const { clientWidth, clientHeight } = canvas;
      canvas.width = clientWidth * devicePixelRatio;
      canvas.height = clientHeight * devicePixelRatio;
      map.resize(clientWidth, clientHeight);
    };
    measure(); // the observer comes with the next frame: keys may be pressed before
    const observer = new ResizeObserver(measure);
    observer.observe(canvas);
    const stopListening = listen(area, map);
    const stopPainting = paintOnChange(canvas, map);
    const stopFitting = effect(() => {
      void map.contents.everything.value;
      map.fitUnlessChosen();
    });
    return () => {
      observer.disconnect();
      stopListening();
      stopPainting();
      stopFitting();
    };
  }, [map]);
  const drawing = map.sketch.use.value !== null || map.store.pick.value !== null;
  return (
    <div
      class={`map-canvas ${drawing ? "drawing" : ""}`}
      role="application"
      // biome-ignore lint/a11y/noNoninteractiveTabindex: keys move its cross-hair
      tabIndex={0}
      aria-label={strings.map.label}
      aria-describedby="map-keys"
    >
      <canvas ref={element} />
    </div>
  );
}

/** Paint at most once per frame of the screen. */
function paintOnChange(canvas: HTMLCanvasElement, map: MapState): () => void {
  // Drawn by the processor, in some 10 ms: software that stands in for a GPU needs a second for so many shapes.
  const context = canvas.getContext("2d", { willReadFrequently: true }) as CanvasRenderingContext2D;
  let waiting = 0;
  const stop = effect(() => {
    void map.picture.value;
    waiting ||= requestAnimationFrame(() => {
      waiting = 0;
      context.setTransform(devicePixelRatio, 0, 0, devicePixelRatio, 0, 0);
      paintMap(context, map.picture.peek());
    });
  });
  return () => {
    cancelAnimationFrame(waiting);
    stop();
  };
}
