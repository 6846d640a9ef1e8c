import { useEffect, useState } from "preact/hooks";
import type { Schemas } from "../api/service";
import { report } from "../store/notices";
import { strings } from "../strings";
import { NewScene } from "./new-scene";
import { SceneList } from "./scene-list";
import { SceneRow } from "./scene-row";
import "./scenes.css";

const REFRESH_MS = 5000;
const texts = strings.scenes;

/** All scenes: a table to search in, with what can be done to each. */
export function ScenesPage() {
  const [list] = useState(() => new SceneList());
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
  const scenes = list.scenes.value;
  const searched = list.searched.value;
  const none = scenes?.length === 0 && !searched;
  return (
    <section class="page scenes">
      <div class="toolbar">
        <h1 class="grow">{texts.title}</h1>
        {scenes !== null && !none && (
          <input
            type="search"
            placeholder={texts.search}
            aria-label={texts.search}
            onInput={(event) => list.search(event.currentTarget.value).catch(report)}
          />
        )}
        <button type="button" class="primary" onClick={() => setCreating(true)}>
          {texts.create}
        </button>
      </div>
      {creating && <NewScene onClose={() => setCreating(false)} />}
      {scenes === null && <p class="loading">{texts.loading}</p>}
      {none && (
        <div class="empty">
          <h2>{texts.empty}</h2>
          <p>{texts.emptyHint}</p>
        </div>
      )}
      {scenes?.length === 0 && searched && <p class="muted">{texts.noneFound(searched)}</p>}
      {scenes !== null && scenes.length > 0 && <Table scenes={scenes} version={version} onChange={reload} />}
      {list.hasMore.value && (
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
  scenes: readonly Schemas["Scene"][];
  version: number;
  onChange: () => void;
}

function Table({ scenes, version, onChange }: TableProps) {
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
