import { loadTerrain } from "../api/artifacts";
import { inOrder, siteOf } from "../candidates/site";
import { numberOf } from "../candidates/values";
import { CheckField, NumberField } from "../components/fields";
import { PickPlace } from "../components/pick-place";
import { heightIn } from "../geometry/terrain";
import { notify, report } from "../store/notices";
import type { Place, SceneStore } from "../store/scene";
import { strings } from "../strings";
import type { MissionForm } from "./mission-form";

interface HomeFieldsProps {
  store: SceneStore;
  form: MissionForm;
  onChange: (change: Partial<MissionForm>) => void;
}

const texts = strings.plans.mission;

/** Where the vehicle takes off, and how high that is. */
export function HomeFields({ store, form, onChange }: HomeFieldsProps) {
  const datum = strings.views.card.datums[store.scene.value?.origin?.altitude_datum ?? "sea-level"];
  const place = homePlace(form);
  const take = async (home: Place) => {
    const { latitude_deg, longitude_deg } = home;
    const altitude = await groundAt(store, home);
    onChange({
      home: true,
      latitude: latitude_deg.toFixed(7),
      longitude: longitude_deg.toFixed(7),
      altitude: altitude === null ? "" : altitude.toFixed(1),
    });
    if (altitude === null) notify("warning", texts.noGround);
  };
  const first = firstPhotograph(store);
  return (
    <fieldset>
      <legend>{texts.homeGroup}</legend>
      <CheckField checked={form.home} onChecked={(home) => onChange({ home })}>
        {texts.home}
      </CheckField>
      {form.home ? (
        <>
          <p class="actions">
            <PickPlace store={store} place={null} onPlace={(picked) => void take(picked).catch(report)} />
            <button
              type="button"
              disabled={first === null}
              onClick={() => first && void take(first).catch(report)}
            >
              {texts.fromFirst}
            </button>
          </p>
          <div class="fields">
            <NumberField
              label={texts.latitude}
              value={form.latitude}
              onValue={(latitude) => onChange({ latitude })}
            />
            <NumberField
              label={texts.longitude}
              value={form.longitude}
              onValue={(longitude) => onChange({ longitude })}
            />
            <NumberField
              label={texts.altitude}
              value={form.altitude}
              onValue={(altitude) => onChange({ altitude })}
            />
            <NumberField
              label={texts.aboveTakeoff}
              value={form.aboveTakeoff}
              onValue={(aboveTakeoff) => onChange({ aboveTakeoff })}
            />
          </div>
          <p class="hint">{texts.altitudeHint(datum)}</p>
          <button
            type="button"
            disabled={place === null}
            onClick={() => place && void take(place).catch(report)}
          >
            {texts.fromGround}
          </button>
        </>
      ) : (
        <p class="hint">{texts.noTakeoff}</p>
      )}
    </fieldset>
  );
}

function homePlace(form: MissionForm): Place | null {
  const latitude_deg = numberOf(form.latitude);
  const longitude_deg = numberOf(form.longitude);
  return latitude_deg === undefined || longitude_deg === undefined ? null : { latitude_deg, longitude_deg };
}

/** Where the first registered photograph was taken; null in a scene that is not on Earth. */
function firstPhotograph(store: SceneStore): Place | null {
  const site = siteOf(store);
  const digest = site && inOrder(site)[0];
  const view = site?.cameras.views.find(({ image }) => image === digest);
  return (view && site?.frames.georeferenced && site.frames.geodeticFromModel(view.position)) || null;
}

/** The altitude of the ground at a place by the shown snapshot; null where it shows none. */
async function groundAt(store: SceneStore, place: Place): Promise<number | null> {
  const snapshot = store.snapshot.value;
  const terrain = snapshot && (await loadTerrain(snapshot));
  return terrain && heightIn(terrain, place);
}
