import { useState } from "preact/hooks";
import { imagePath } from "../api/paths";
import type { Schemas } from "../api/service";
import { Dialog } from "../components/dialog";
import { ServiceImage } from "../components/service-image";
import type { SceneProps, SceneStore } from "../store/scene";
import { strings } from "../strings";
import { CandidateCard } from "./candidate-card";
import "./selection-card.css";

/** What is selected, on the stage: an image with its photograph, a candidate, or a stop of a plan. */
export function SelectionCard({ store }: SceneProps) {
  const selection = store.selection.value;
  if (selection === null) return null;
  const image = selection.kind === "image" && store.imageByDigest.value.get(selection.digest);
  const title = image ? image.name : selection.kind === "image" ? selection.digest : selection.id;
  const close = () => {
    store.selection.value = null;
  };
  return (
    <aside class="selection-card" aria-label={strings.view3d.card.label}>
      <header>
        <h2>{title}</h2>
        <button type="button" class="quiet" aria-label={strings.components.close} onClick={close}>
          ×
        </button>
      </header>
      {image && <ImageDetails store={store} image={image} />}
      {selection.kind !== "image" && <CandidateCard store={store} id={selection.id} />}
    </aside>
  );
}

interface ImageDetailsProps {
  store: SceneStore;
  image: Schemas["Image"];
}

function ImageDetails({ store, image }: ImageDetailsProps) {
  const [enlarged, setEnlarged] = useState(false);
  const texts = strings.view3d.card;
  const view = store.cameras.value?.views.find((one) => one.image === image.digest);
  const path = (of: "content" | "thumbnail") => imagePath(store.id, image.digest, of);
  return (
    <>
      {image.verdict === "accepted" && (
        <ServiceImage path={path("thumbnail")} alt={image.name} class="thumbnail" />
      )}
      <p>
        {strings.photographs.registrations[image.registration]}. {image.reason}{" "}
        <span class="hint">{image.hint}</span>
      </p>
      <p class="actions">
        {view && (
          <button
            type="button"
            onClick={() => {
              store.lookThrough.value = { position: view.position, orientation: view.orientation_wxyz };
            }}
          >
            {texts.lookThrough}
          </button>
        )}
        <button type="button" onClick={() => setEnlarged(true)}>
          {texts.showPhotograph}
        </button>
      </p>
      {enlarged && (
        <Dialog title={image.name} onClose={() => setEnlarged(false)}>
          <ServiceImage path={path("content")} alt={image.name} class="photograph" />
        </Dialog>
      )}
    </>
  );
}
