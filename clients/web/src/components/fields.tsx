import type { ComponentChildren } from "preact";

interface NumberFieldProps {
  label: string;
  value: string;
  onValue: (value: string) => void;
  min?: number;
  max?: number;
  step?: number | "any";
  /** What holds while it is empty. */
  placeholder?: string;
  disabled?: boolean;
}

/** A number of a form, as text: empty where the service chooses. */
export function NumberField({
  label,
  value,
  onValue,
  min,
  max,
  step = "any",
  placeholder,
  disabled,
}: NumberFieldProps) {
  return (
    <label>
      {label}
      <input
        type="number"
        value={value}
        onInput={(event) => onValue(event.currentTarget.value)}
        {...{ min, max, step, placeholder, disabled }}
      />
    </label>
  );
}

interface SelectFieldProps<T extends string> {
  label: string;
  value: T;
  onValue: (value: T) => void;
  options: readonly { value: T; title: string; disabled?: boolean }[];
  hint?: string;
}

/** One of several words. */
export function SelectField<T extends string>({ label, value, onValue, options, hint }: SelectFieldProps<T>) {
  return (
    <label>
      {label}
      <select value={value} onChange={(event) => onValue(event.currentTarget.value as T)}>
        {options.map((option) => (
          <option key={option.value} value={option.value} disabled={option.disabled ?? false}>
            {option.title}
          </option>
        ))}
      </select>
      {hint && <span class="hint">{hint}</span>}
    </label>
  );
}

interface CheckFieldProps {
  checked: boolean;
  onChecked: (checked: boolean) => void;
  disabled?: boolean;
  children: ComponentChildren;
}

/** Yes or no. */
export function CheckField({ checked, onChecked, disabled, children }: CheckFieldProps) {
  return (
    <label class="check">
      <input
        type="checkbox"
        checked={checked}
        disabled={disabled}
        onChange={(event) => onChecked(event.currentTarget.checked)}
      />
      <span>{children}</span>
    </label>
  );
}
