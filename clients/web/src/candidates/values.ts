/** The number in a field of a form; undefined when it is empty, which leaves the choice to the service. */
export function numberOf(text: string): number | undefined {
  const number = Number(text);
  return text.trim() === "" || !Number.isFinite(number) ? undefined : number;
}

/** Those properties that have a value. */
export function given<T extends object>(properties: T): { [Name in keyof T]?: Exclude<T[Name], undefined> } {
  return Object.fromEntries(Object.entries(properties).filter(([, value]) => value !== undefined)) as {
    [Name in keyof T]?: Exclude<T[Name], undefined>;
  };
}

/** Something that is missing in a form, as a sentence for the operator. */
export class FormError extends Error {
  override name = "FormError";
}
