import { useEffect } from "preact/hooks";
import { apiKey, keyRefusal } from "./api/key";
import { KeyDialog } from "./components/key-dialog";
import { Notices } from "./components/notices";
import { hrefOf, route } from "./router";
import { ScenePage } from "./scene/scene-page";
import { ScenesPage } from "./scenes/scenes-page";
import { capabilities, loadCapabilities } from "./store/capabilities";
import { strings } from "./strings";
import { toggleTheme } from "./theme";

/** The whole page: its header, what the route names, notices, and the dialog for the API key. */
export function App() {
  const key = apiKey.value;
  useEffect(() => void loadCapabilities(), [key]);
  const now = route.value;
  return (
    <>
      {/* biome-ignore lint/a11y/useValidAnchor: the URL's fragment is the route, so it cannot lead to a place, too. */}
      <a
        class="skip"
        href="#content"
        onClick={(event) => {
          event.preventDefault();
          document.getElementById("content")?.focus();
        }}
      >
        {strings.skip}
      </a>
      <header class="bar">
        <a class="brand" href={hrefOf({ page: "scenes" })}>
          {strings.product}
        </a>
        <span id="title" class="grow" />
        <a href="/docs">{strings.documentation}</a>
        {(capabilities.value?.keys_required || key !== null) && (
          <button
            type="button"
            class="quiet"
            onClick={() => {
              keyRefusal.value = { message: "", hint: "" };
            }}
          >
            {strings.key.title}
          </button>
        )}
        <button
          type="button"
          class="quiet"
          onClick={toggleTheme}
          title={strings.theme}
          aria-label={strings.theme}
        >
          ◐
        </button>
      </header>
      <main id="content" tabIndex={-1}>
        {now.page === "scenes" ? (
          <ScenesPage key={key} />
        ) : (
          <ScenePage
            key={`${now.sceneId} ${key}`}
            sceneId={now.sceneId}
            stage={now.stage}
            panel={now.panel}
          />
        )}
      </main>
      <Notices />
      <KeyDialog />
    </>
  );
}
