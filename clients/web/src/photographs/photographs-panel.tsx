import { useEffect, useMemo, useState } from "preact/hooks";
import type { Schemas } from "../api/service";
import { formatCount } from "../components/format";
import { ServiceImage } from "../components/service-image";
import { VirtualList } from "../components/virtual-list";
import type { SceneProps } from "../store/scene";
import { strings } from "../strings";
import { AddFiles } from "./add-files";
import { countsOf, FILTERS, type Filter, filtered } from "./filters";
import { ImageState, remarkOf, thumbnailOf } from "./image-state";
import { PhotographDetails } from "./photograph-details";
import { UploadProgress } from "./upload-progress";
import { uploadsOf } from "./uploads";
import "./photographs.css";

const texts = strings.photographs;
const ROW_PX = 60;
/** How long a row is in sight before its thumbnail is loaded: scrolling past loads none. */
const SETTLED_MS = 120;

/** The photographs of the scene: adding, finding and judging them. */
export function PhotographsPanel({ store }: SceneProps) {
  const [filter, setFilter] = useState<Filter>("all");
  const [text, setText] = useState("");
  const images = store.images.value;
  const counts = useMemo(() => countsOf(images), [images]);
  const shown = useMemo(() => filtered(images, filter, text), [images, filter, text]);
  const selection = store.selection.value;
  const digest = selection?.kind === "image" ? selection.digest : null;
  const selected = digest === null ? null : (store.imageByDigest.value.get(digest) ?? null);
  const select = (image: Schemas["Image"]) => {
    store.selection.value = { kind: "image", digest: image.digest };
  };
  const step = (by: number) => {
    const at = shown.findIndex((image) => image.digest === digest);
    const next = shown[Math.min(Math.max(at + by, 0), shown.length - 1)];
    if (next) select(next);
  };
  const uploads = uploadsOf(store.id);
  const empty =
    images.length === 0 && uploads.totals.value.open === 0 && store.connection.value !== "connecting";
  return (
    <div class="photographs">
      <AddFiles sceneId={store.id} />
      <UploadProgress queue={uploads} />
      {empty && (
        <div class="empty">
          <h2>{texts.empty}</h2>
          <p>{texts.emptyHint}</p>
        </div>
      )}
      {images.length > 0 && (
        <>
          <div class="find">
            <select
              aria-label={texts.filter}
              value={filter}
              onChange={(event) => setFilter(event.currentTarget.value as Filter)}
            >
              {FILTERS.map((one) => (
                <option key={one} value={one}>
                  {texts.filters[one]} ({formatCount(counts[one])})
                </option>
              ))}
            </select>
            <input
              type="search"
              value={text}
              placeholder={texts.search}
              aria-label={texts.search}
              onInput={(event) => setText(event.currentTarget.value)}
            />
          </div>
          {shown.length === 0 && <p class="muted none">{texts.none}</p>}
          <VirtualList
            label={texts.list}
            items={shown}
            rowHeight={ROW_PX}
            keyOf={(image) => image.digest}
            selected={digest}
            onSelect={select}
          >
            {(image) => <Row image={image} />}
          </VirtualList>
        </>
      )}
      {selected && (
        <PhotographDetails
          key={selected.digest}
          image={selected}
          onStep={step}
          onClose={() => {
            store.selection.value = null;
          }}
        />
      )}
    </div>
  );
}

function Row({ image }: { image: Schemas["Image"] }) {
  const thumbnail = thumbnailOf(image);
  const [settled, setSettled] = useState(false);
  useEffect(() => {
    const timer = setTimeout(() => setSettled(true), SETTLED_MS);
    return () => clearTimeout(timer);
  }, []);
  return (
    <div class="photograph-row">
      {thumbnail && settled ? (
        <ServiceImage path={thumbnail} alt="" class="thumbnail" />
      ) : (
        <span class="thumbnail none" />
      )}
      <span class="what">
        <span class="name">{image.name}</span>
        <span class="remark small muted">{remarkOf(image)}</span>
      </span>
      <ImageState image={image} />
    </div>
  );
}
