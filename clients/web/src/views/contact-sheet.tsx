import { useRef } from "preact/hooks";
import { picturePath } from "../api/paths";
import type { Schemas } from "../api/service";
import { ServiceImage } from "../components/service-image";
import { useVisible } from "../components/use-visible";
import type { SceneStore } from "../store/scene";
import { strings } from "../strings";

const texts = strings.views.sheet;

interface ContactSheetProps {
  store: SceneStore;
  ranking: Schemas["Ranking"];
  /** How many candidates are shown. */
  k: number;
}

/** Renders above spectra of the first candidates, loaded when they come into sight. */
export function ContactSheet({ store, ranking, k }: ContactSheetProps) {
  if (!store.snapshots.value.some(({ id }) => id === ranking.snapshot_id)) {
    return <p class="hint">{texts.snapshotGone}</p>;
  }
  const first = ranking.candidates.filter(({ rank }) => rank !== null).slice(0, k);
  return (
    <div class="contact-sheet">
      {first.map((candidate) => (
        <Pictures
          key={`${ranking.id} ${candidate.id}`}
          store={store}
          ranking={ranking}
          candidate={candidate}
        />
      ))}
    </div>
  );
}

interface PicturesProps {
  store: SceneStore;
  ranking: Schemas["Ranking"];
  candidate: Schemas["RankedCandidate"];
}

function Pictures({ store, ranking, candidate }: PicturesProps) {
  const element = useRef<HTMLButtonElement>(null);
  const visible = useVisible(element);
  const selection = store.selection.value;
  const { id } = candidate;
  return (
    <button
      type="button"
      ref={element}
      class="pictures"
      aria-pressed={selection?.kind === "candidate" && selection.id === id}
      onClick={() => {
        store.selection.value = { kind: "candidate", id };
      }}
    >
      {visible ? (
        <>
          <ServiceImage path={picturePath(ranking.id, id, "render")} alt={texts.render(id)} />
          <ServiceImage path={picturePath(ranking.id, id, "spectrum")} alt={texts.spectrum(id)} />
        </>
      ) : (
        <span class="placeholder" />
      )}
      <span>{texts.figure(candidate.rank ?? 0, id)}</span>
    </button>
  );
}
