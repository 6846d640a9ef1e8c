import type { SceneProps } from "../store/scene";
import { strings } from "../strings";
import { Growth } from "./growth";
import { JobCard } from "./job-card";
import { isOpen } from "./job-progress";
import { Snapshots } from "./snapshots";
import { StartJob } from "./start-job";
import "./work.css";

const texts = strings.work;

/** What the service does for the scene: open jobs, new ones, how the model grew, its snapshots, earlier jobs. */
export function WorkPanel({ store }: SceneProps) {
  const jobs = store.jobs.value;
  const open = jobs.filter(isOpen);
  const earlier = jobs.filter((job) => !isOpen(job));
  return (
    <div class="work">
      <section>
        <h2>{texts.now}</h2>
        {open.length === 0 && <p class="muted">{texts.nothing}</p>}
        {open.map((job) => (
          <JobCard key={job.id} job={job} store={store} />
        ))}
        <StartJob store={store} />
      </section>
      <Growth store={store} />
      <Snapshots store={store} />
      {earlier.length > 0 && (
        <section>
          <h2>{texts.history}</h2>
          {earlier.map((job) => (
            <JobCard key={job.id} job={job} store={store} />
          ))}
        </section>
      )}
    </div>
  );
}
