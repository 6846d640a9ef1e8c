import { useState } from "preact/hooks";
import type { Schemas } from "../api/service";
import { show } from "../router";
import type { SceneProps } from "../store/scene";
import { strings } from "../strings";

const texts = strings.work;
const SHOWN = 4;

/** What limits the use of a job's result; the images that it is about lead to their details. */
export function Remarks({ remarks, store }: SceneProps & { remarks: readonly Schemas["Notice"][] }) {
  if (remarks.length === 0) return null;
  return (
    <details class="remarks" open={remarks.some((one) => one.severity !== "note")}>
      <summary class="small">{texts.warnings(remarks.length)}</summary>
      <ul>
        {remarks.map((remark, index) => (
          <li key={index} class={`small ${remark.severity}`}>
            <span class="visually-hidden">{texts.severities[remark.severity]}: </span>
            {remark.message} <span class="hint">{remark.hint}</span>
            <Images digests={remark.images} store={store} />
          </li>
        ))}
      </ul>
    </details>
  );
}

function Images({ digests, store }: SceneProps & { digests: readonly string[] }) {
  const [all, setAll] = useState(false);
  const known = store.imageByDigest.value;
  const images = [...new Set(digests)].flatMap((digest) => known.get(digest) ?? []);
  if (images.length === 0) return null;
  const shown = all ? images : images.slice(0, SHOWN);
  return (
    <span class="images">
      {shown.map((image) => (
        <button
          key={image.digest}
          type="button"
          class="quiet"
          aria-label={texts.image(image.name)}
          onClick={() => {
            store.selection.value = { kind: "image", digest: image.digest };
            show({ panel: "photographs" });
          }}
        >
          {image.name}
        </button>
      ))}
      {shown.length < images.length && (
        <button type="button" class="quiet" onClick={() => setAll(true)}>
          {texts.moreImages(images.length - shown.length)}
        </button>
      )}
    </span>
  );
}
