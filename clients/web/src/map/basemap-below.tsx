import { effect, signal } from "@preact/signals";
import { useEffect, useRef, useState } from "preact/hooks";
import type { Schemas } from "../api/service";
import { capabilities } from "../store/capabilities";
import { strings } from "../strings";
import { theme } from "../theme";
import type { Basemap } from "./basemap";
import type { MapState } from "./map-state";

/** The operator's tiles below the map; nothing while none are set. The map works without them. */
export function BasemapBelow({ map }: { map: MapState }) {
  const basemap = capabilities.value?.basemap ?? null;
  return basemap && map.contents.frame.value.enu ? (
    <Tiles key={basemap.url} map={map} basemap={basemap} />
  ) : null;
}

function Tiles({ map, basemap }: { map: MapState; basemap: Schemas["Basemap"] }) {
  const element = useRef<HTMLDivElement>(null);
  const [failure] = useState(() => signal<string | null>(null));
  useEffect(() => {
    let closed = false;
    let opened: Basemap | null = null;
    let stop = () => {};
    const fail = () => {
      if (!map.tiles.peek()) failure.value = strings.map.basemapFailed;
    };
    const arrive = () => {
      failure.value = null;
      map.tiles.value = true;
    };
    const open = async () => {
      const { openBasemap } = await import("./basemap");
      if (closed) return;
      const got = await openBasemap(element.current as HTMLElement, basemap, theme.peek(), arrive, fail);
      if (closed) got.remove();
      else opened = got;
      let shown = theme.peek();
      stop = effect(() => {
        if (shown !== theme.value) got.setTheme(theme.value);
        shown = theme.value;
        got.show(map.view.value, map.contents.frame.value);
      });
    };
    if (hasWebGl()) open().catch(fail);
    else failure.value = strings.map.noWebGl;
    return () => {
      closed = true;
      stop();
      opened?.remove();
      map.tiles.value = false;
    };
  }, [map, basemap, failure]);
  return (
    <>
      <div ref={element} class="map-basemap" aria-hidden="true" />
      {failure.value && (
        <p class="map-card map-failure" role="status">
          {failure.value}
        </p>
      )}
      {map.tiles.value && basemap.attribution && <p class="map-attribution">{basemap.attribution}</p>}
    </>
  );
}

function hasWebGl(): boolean {
  return document.createElement("canvas").getContext("webgl2") !== null;
}
