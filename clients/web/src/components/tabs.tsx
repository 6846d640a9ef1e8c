interface TabsProps<T extends string> {
  label: string;
  tabs: readonly { id: T; title: string; href: string }[];
  current: T;
}

/** Links between parts of the page, of which one is shown. */
export function Tabs<T extends string>({ label, tabs, current }: TabsProps<T>) {
  return (
    <nav class="tabs" aria-label={label}>
      {tabs.map((tab) => (
        <a key={tab.id} href={tab.href} aria-current={tab.id === current ? "page" : undefined}>
          {tab.title}
        </a>
      ))}
    </nav>
  );
}
