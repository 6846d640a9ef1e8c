import { signal } from "@preact/signals";
import { api, data, type Schemas } from "../api/service";
import { strings } from "../strings";
import { notify, report } from "./notices";

/** What the service can do; null until it has answered. */
export const capabilities = signal<Schemas["Capabilities"] | null>(null);

/** Ask the service what it can do; a page of another version says so. */
export async function loadCapabilities(): Promise<void> {
  try {
    const got = await data(api.GET("/v1/capabilities"));
    capabilities.value = got;
    if (got.version !== __FVS_VERSION__) {
      notify("warning", strings.otherVersion(got.version, __FVS_VERSION__), strings.otherVersionHint);
    }
  } catch (error) {
    report(error);
  }
}
