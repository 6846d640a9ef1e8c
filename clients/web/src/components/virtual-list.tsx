import type { ComponentChildren } from "preact";
import { useEffect, useLayoutEffect, useRef, useState } from "preact/hooks";
import "./virtual-list.css";

const BEYOND = 4; // rows above and below those in sight

interface VirtualListProps<T> {
  label: string;
  items: readonly T[];
  /** The height of each row, in px. */
  rowHeight: number;
  keyOf: (item: T) => string;
  /** The key of the selected item; null when none is. */
  selected: string | null;
  onSelect: (item: T) => void;
  children: (item: T) => ComponentChildren;
}

/** A list of which only the rows in sight exist; the arrow keys, Home, End and the page keys select. */
export function VirtualList<T>(props: VirtualListProps<T>) {
  const { items, rowHeight, keyOf, selected } = props;
  const box = useRef<HTMLDivElement>(null);
  const [sight, setSight] = useState({ top: 0, height: 0 });
  const index = selected === null ? -1 : items.findIndex((item) => keyOf(item) === selected);
  const look = () => {
    if (box.current) setSight({ top: box.current.scrollTop, height: box.current.clientHeight });
  };
  useLayoutEffect(() => {
    look();
    const observer = new ResizeObserver(look);
    if (box.current) observer.observe(box.current);
    return () => observer.disconnect();
  }, []);
  useEffect(() => {
    if (box.current && index >= 0) bringIntoSight(box.current, index * rowHeight, rowHeight);
  }, [selected, sight.height]);
  const move = (event: KeyboardEvent) => {
    const page = Math.max(1, Math.floor(sight.height / rowHeight) - 1);
    const to = targetOf(event.key, index, page, items.length);
    const item = to === null ? undefined : items[to];
    if (item === undefined) return;
    event.preventDefault();
    props.onSelect(item);
  };
  const first = Math.max(0, Math.floor(sight.top / rowHeight) - BEYOND);
  const last = Math.min(items.length, Math.ceil((sight.top + sight.height) / rowHeight) + BEYOND);
  return (
    <div
      ref={box}
      class="virtual-list"
      role="listbox"
      tabIndex={0}
      aria-label={props.label}
      aria-activedescendant={index >= first && index < last ? rowId(index) : undefined}
      onScroll={look}
      onKeyDown={move}
    >
      <div class="space" role="presentation" style={{ height: `${items.length * rowHeight}px` }}>
        {items.slice(first, last).map((item, offset) => (
          // biome-ignore lint/a11y/useKeyWithClickEvents: the list handles the keys
          // biome-ignore lint/a11y/useFocusableInteractive: the list has the focus
          <div
            key={keyOf(item)}
            id={rowId(first + offset)}
            class="row"
            role="option"
            aria-selected={first + offset === index}
            aria-posinset={first + offset + 1}
            aria-setsize={items.length}
            style={{ top: `${(first + offset) * rowHeight}px`, height: `${rowHeight}px` }}
            onClick={() => props.onSelect(item)}
          >
            {props.children(item)}
          </div>
        ))}
      </div>
    </div>
  );
}

/** Where a key leads from an index (−1: from none) in a list; null when it leads nowhere. */
export function targetOf(key: string, index: number, page: number, length: number): number | null {
  const steps: Record<string, number> = {
    ArrowDown: index + 1,
    ArrowUp: index < 0 ? length - 1 : index - 1,
    PageDown: index + page,
    PageUp: index - page,
    Home: 0,
    End: length - 1,
  };
  const to = steps[key];
  if (to === undefined || length === 0) return null;
  return Math.min(Math.max(to, 0), length - 1);
}

function rowId(index: number): string {
  return `row-${index}`;
}

function bringIntoSight(box: HTMLElement, top: number, height: number): void {
  if (top < box.scrollTop) box.scrollTop = top;
  else if (top + height > box.scrollTop + box.clientHeight) box.scrollTop = top + height - box.clientHeight;
}
