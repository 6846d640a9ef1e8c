/** What a storage of the browser has as JSON under a name; `usual` where it has nothing, or something else. */
export function stored<T extends object>(storage: Storage, name: string, usual: T): T {
  try {
    const found: unknown = JSON.parse(storage.getItem(name) ?? "null");
    const fits = typeof found === "object" && found !== null && Array.isArray(found) === Array.isArray(usual);
    return fits ? (found as T) : usual;
  } catch {
    return usual;
  }
}
