import type { ComponentType } from "preact";
import { useEffect, useState } from "preact/hooks";
import { report } from "../store/notices";
import { strings } from "../strings";

/** A component that is loaded, as a chunk of its own, when it is first shown. */
export function lazy<P extends object>(load: () => Promise<ComponentType<P>>): ComponentType<P> {
  let loaded: ComponentType<P> | null = null;
  return function Lazy(props: P) {
    const [, setReady] = useState(loaded !== null);
    useEffect(() => {
      if (loaded) return;
      load()
        .then((component) => {
          loaded = component;
          setReady(true);
        })
        .catch(report);
    }, []);
    if (!loaded) return <p class="loading">{strings.loading}</p>;
    const Component = loaded;
    return <Component {...props} />;
  };
}
