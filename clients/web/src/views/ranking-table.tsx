import { useEffect, useLayoutEffect, useRef, useState } from "preact/hooks";
import type { Schemas } from "../api/service";
import { metric } from "../candidates/site";
import { formatLength, formatScore, formatShare } from "../components/format";
import type { SceneStore } from "../store/scene";
import { strings } from "../strings";
import { COLUMNS, type Column, type Order, sorted } from "./order";

const texts = strings.views.table;
const PAGE = 50;
const NUMBERS: readonly Column[] = ["rank", "score", "coverage", "chance", "distance"];

interface RankingTableProps {
  store: SceneStore;
  candidates: readonly Schemas["RankedCandidate"][];
}

/** The candidates of a ranking, in pages; arrow keys go from row to row, and the selected one is shown. */
export function RankingTable({ store, candidates }: RankingTableProps) {
  const [order, setOrder] = useState<Order>({ column: "rank", descending: false });
  const [page, setPage] = useState(0);
  const body = useRef<HTMLTableSectionElement>(null);
  const rows = sorted(candidates, order);
  const selection = store.selection.value;
  const selected = selection?.kind === "candidate" ? selection.id : null;
  const at = rows.findIndex(({ id }) => id === selected);
  useEffect(() => {
    if (at >= 0) setPage(Math.floor(at / PAGE));
  }, [at]);
  const first = Math.min(page, Math.floor(Math.max(0, rows.length - 1) / PAGE)) * PAGE;
  const shown = rows.slice(first, first + PAGE);
  const current = at >= first && at < first + PAGE ? at - first : 0;
  const focusSelected = useRef(false);
  useLayoutEffect(() => {
    const row = body.current?.querySelector<HTMLElement>("tr[aria-selected='true']");
    if (!focusSelected.current || !row) return;
    focusSelected.current = false;
    row.focus();
  });
  const select = (index: number) => {
    const at = Math.max(0, Math.min(rows.length - 1, index));
    const row = rows[at];
    if (!row) return;
    focusSelected.current = true;
    setPage(Math.floor(at / PAGE));
    store.selection.value = { kind: "candidate", id: row.id };
  };
  const onKeyDown = (event: KeyboardEvent, index: number) => {
    const to = target(event.key, index, rows.length);
    if (to === null) return;
    event.preventDefault();
    select(to);
  };
  const sort = (column: Column) =>
    setOrder({ column, descending: order.column === column && !order.descending });
  return (
    <div class="ranking-table">
      <div class="scrolled">
        <table>
          <thead>
            <tr>
              {COLUMNS.map((column) => (
                <th
                  key={column}
                  scope="col"
                  class={NUMBERS.includes(column) ? "number" : ""}
                  aria-sort={
                    order.column === column ? (order.descending ? "descending" : "ascending") : "none"
                  }
                >
                  <button type="button" class="quiet" onClick={() => sort(column)}>
                    {texts.columns[column]}
                    {order.column === column && (
                      <span aria-hidden="true">{order.descending ? " ↓" : " ↑"}</span>
                    )}
                  </button>
                </th>
              ))}
            </tr>
          </thead>
          <tbody ref={body}>
            {shown.map((row, index) => (
              <tr
                key={row.id}
                tabIndex={index === current ? 0 : -1}
                aria-selected={row.id === selected}
                onClick={() => select(first + index)}
                onKeyDown={(event) => onKeyDown(event, first + index)}
              >
                <td class="number">{row.rank ?? strings.components.unknown}</td>
                <td>{row.id}</td>
                <td class="number" title={row.estimated ? texts.estimated : undefined}>
                  {row.estimated && "≈ "}
                  {formatScore(row.score)}
                </td>
                <td class="number">{formatShare(row.coverage)}</td>
                <td class="number">{formatShare(row.chance)}</td>
                <td class="number">{formatLength(row.distance_m, metric(store))}</td>
                <td>{strings.views.statuses[row.status]}</td>
              </tr>
            ))}
          </tbody>
        </table>
      </div>
      {rows.length > PAGE && (
        <p class="pages">
          <button type="button" disabled={first === 0} onClick={() => setPage(first / PAGE - 1)}>
            {texts.previous}
          </button>
          <span>{texts.page(first + 1, first + shown.length, rows.length)}</span>
          <button
            type="button"
            disabled={first + PAGE >= rows.length}
            onClick={() => setPage(first / PAGE + 1)}
          >
            {texts.next}
          </button>
        </p>
      )}
    </div>
  );
}

/** The row to which a key goes; null for other keys. */
function target(key: string, index: number, count: number): number | null {
  const targets: Record<string, number> = {
    ArrowDown: index + 1,
    ArrowUp: index - 1,
    PageDown: index + PAGE,
    PageUp: index - PAGE,
    Home: 0,
    End: count - 1,
    Enter: index,
    " ": index,
  };
  return targets[key] ?? null;
}
