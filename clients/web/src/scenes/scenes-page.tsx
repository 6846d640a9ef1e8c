import { useEffect, useState } from "preact/hooks";
import { report } from "../store/notices";
import { strings } from "../strings";
import { NewScene } from "./new-scene";
import { named, SceneList } from "./scene-list";
import { SceneRow } from "./scene-row";
import "./scenes.css";

const REFRESH_MS = 5000;
const texts = strings.scenes;

/** All scenes: a table to search in, with what can be done to each. */
export function ScenesPage() {
  const [list] = useState(() => new SceneList());
  const [text, setText] = useState("");
  const [creating, setCreating] = useState(false);
  const [version, setVersion] = useState(0);
  const reload = () => {
    list
      .reload()
      .then(() => setVersion((before) => before + 1))
      .catch(report);
  };
  useEffect(() => {
    reload();
    const timer = setInterval(() => {
      if (document.visibilityState === "visible") reload();
    }, REFRESH_MS);
    return () => clearInterval(timer);
  }, []);
  const search = (wanted: string) => {
    setText(wanted);
    if (wanted.trim()) list.loadAll().catch(report);
  };
  const scenes = list.scenes.value;
  return (
    <section class="page scenes">
      <div class="toolbar">
        <h1 class="grow">{texts.title}</h1>
        {scenes !== null && scenes.length > 0 && (
          <input
            type="search"
            value={text}
            placeholder={texts.search}
            aria-label={texts.search}
            onInput={(event) => search(event.currentTarget.value)}
          />
        )}
        <button type="button" class="primary" onClick={() => setCreating(true)}>
          {texts.create}
        </button>
      </div>
      {creating && <NewScene onClose={() => setCreating(false)} />}
      {scenes === null && <p class="loading">{texts.loading}</p>}
      {scenes?.length === 0 && (
        <div class="empty">
          <h2>{texts.empty}</h2>
          <p>{texts.emptyHint}</p>
        </div>
      )}
      {scenes !== null && scenes.length > 0 && (
        <Table scenes={named(scenes, text)} text={text} version={version} onChange={reload} />
      )}
      {list.hasMore.value && !text.trim() && (
        <p>
          <button type="button" onClick={() => list.loadMore().catch(report)}>
            {texts.more}
          </button>
        </p>
      )}
    </section>
  );
}

interface TableProps {
  scenes: ReturnType<typeof named>;
  text: string;
  version: number;
  onChange: () => void;
}

function Table({ scenes, text, version, onChange }: TableProps) {
  if (scenes.length === 0) return <p class="muted">{texts.noneFound(text.trim())}</p>;
  return (
    <table>
      <thead>
        <tr>
          <th scope="col">{texts.columns.name}</th>
          <th scope="col">{texts.columns.state}</th>
          <th scope="col">{texts.columns.photographs}</th>
          <th scope="col">{texts.columns.model}</th>
          <th scope="col" class="number">
            {texts.columns.size}
          </th>
          <th scope="col">
            <span class="visually-hidden">{texts.columns.actions}</span>
          </th>
        </tr>
      </thead>
      <tbody>
        {scenes.map((scene) => (
          <SceneRow key={scene.id} scene={scene} version={version} onChange={onChange} />
        ))}
      </tbody>
    </table>
  );
}
