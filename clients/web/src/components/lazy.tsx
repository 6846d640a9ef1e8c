import type { ComponentType } from "preact";
import { useEffect, useState } from "preact/hooks";
import { strings } from "../strings";

/** A component that is loaded, as a chunk of its own, when it is first shown. */
export function lazy<P extends object>(load: () => Promise<ComponentType<P>>): ComponentType<P> {
  let loaded: ComponentType<P> | null = null;
  return function Lazy(props: P) {
    const [, setReady] = useState(loaded !== null);
    const [failed, setFailed] = useState(false);
    useEffect(() => {
      if (loaded) return;
      load()
        .then((component) => {
          loaded = component;
          setReady(true);
        })
        .catch(() => setFailed(true));
    }, []);
    if (failed) return <NotLoaded />;
    if (!loaded) return <p class="loading">{strings.loading}</p>;
    const Component = loaded;
    return <Component {...props} />;
  };
}

/** A file of the page is gone after an upgrade of the service, or cannot be reached. */
function NotLoaded() {
  const texts = strings.components;
  return (
    <div class="failure" role="alert">
      <p class="error">{texts.notLoaded}</p>
      <p class="hint">{texts.notLoadedHint}</p>
      <button type="button" onClick={() => location.reload()}>
        {texts.reload}
      </button>
    </div>
  );
}
