import { NumberField, SelectField } from "../components/fields";
import { PickPlace } from "../components/pick-place";
import type { SceneStore } from "../store/scene";
import { strings } from "../strings";
import { VEHICLE, VEHICLE_STARTS, type VehicleForm } from "./plan-form";

interface VehicleFieldsProps {
  store: SceneStore;
  vehicles: readonly VehicleForm[];
  onChange: (vehicles: readonly VehicleForm[]) => void;
}

const texts = strings.plans.form;
const MOST = 20;

/** How many vehicles fly, and where each starts. */
export function VehicleFields({ store, vehicles, onChange }: VehicleFieldsProps) {
  const onEarth = store.frames.value?.georeferenced ?? false;
  const resize = (text: string) => {
    const count = Math.max(1, Math.min(MOST, Math.round(Number(text)) || 1));
    onChange(Array.from({ length: count }, (_, index) => vehicles[index] ?? VEHICLE));
  };
  const set = (index: number, change: Partial<VehicleForm>) =>
    onChange(vehicles.map((one, at) => (at === index ? { ...one, ...change } : one)));
  return (
    <>
      <NumberField
        label={texts.vehicles}
        value={String(vehicles.length)}
        onValue={resize}
        min={1}
        max={MOST}
        step={1}
      />
      {vehicles.map((vehicle, index) => (
        <div key={index} class="fields">
          <SelectField
            label={texts.vehicle(index + 1)}
            value={vehicle.start}
            onValue={(start) => set(index, { start })}
            options={VEHICLE_STARTS.map((value) => ({
              value,
              title: texts.starts[value],
              disabled: value === "place" && !onEarth,
            }))}
          />
          {vehicle.start === "place" && (
            <PickPlace store={store} place={vehicle.place} onPlace={(place) => set(index, { place })} />
          )}
          {vehicle.start === "coordinates" &&
            (onEarth ? texts.earth : texts.world).map((label, axis) => (
              <NumberField
                key={label}
                label={label}
                value={vehicle.coordinates[axis] ?? ""}
                onValue={(text) => {
                  const coordinates = vehicle.coordinates.map((old, at) => (at === axis ? text : old));
                  set(index, { coordinates: coordinates as [string, string, string] });
                }}
              />
            ))}
        </div>
      ))}
    </>
  );
}
