import { useState } from "preact/hooks";
import { report } from "../store/notices";
import { strings } from "../strings";
import { ConfirmDialog } from "./confirm-dialog";
import { formatAge } from "./format";

/** Something that the service made and keeps. */
export interface Kept {
  id: string;
  title: string;
  details: string;
  created_at: string;
}

interface HistoryProps {
  title: string;
  items: readonly Kept[];
  /** The id of the one that is shown. */
  shown: string | null;
  onShow: (id: string) => Promise<void>;
  onDelete: (id: string) => Promise<void>;
}

const texts = strings.views.history;

/** What was made earlier: each can be shown again, or deleted. */
export function History({ title, items, shown, onShow, onDelete }: HistoryProps) {
  const [deleting, setDeleting] = useState<Kept | null>(null);
  return (
    <details class="history">
      <summary>
        {title} ({items.length})
      </summary>
      {items.length === 0 && <p class="hint">{texts.none}</p>}
      <ul>
        {items.map((item) => (
          <li key={item.id} aria-current={item.id === shown ? "true" : undefined}>
            <span class="grow">
              {item.title} <span class="hint">{item.details}</span>{" "}
              <span class="hint">{formatAge(item.created_at)}</span>
            </span>
            <button type="button" onClick={() => void onShow(item.id).catch(report)}>
              {texts.show}
            </button>
            <button type="button" class="quiet" onClick={() => setDeleting(item)}>
              {texts.delete}
            </button>
          </li>
        ))}
      </ul>
      {deleting && (
        <ConfirmDialog
          title={texts.deleteTitle(deleting.title)}
          action={texts.delete}
          onConfirm={() => onDelete(deleting.id)}
          onClose={() => setDeleting(null)}
        >
          <p>{texts.lost}</p>
        </ConfirmDialog>
      )}
    </details>
  );
}
