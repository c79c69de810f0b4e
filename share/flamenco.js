// SPDX-License-Identifier: Apache-2.0
// A Flamenco job type: one task for each frame. Put it into the manager's folder `scripts`. The workers need hexad-frame
// and hexad-worker in PATH.
const JOB_TYPE = {
    label: "hexad",
    description: "Samples surfaces (meshes, volumes, formulas), a task for each frame",
    settings: [
        { key: "spec", type: "string", required: true, description: "Path of the job spec" },
        { key: "output", type: "string", required: true, description: "Results go to OUTPUT/FRAME" },
        { key: "frames", type: "string", required: true, default: "1-10", description: "As 1-10 or 1,5,9" },
    ],
};

function compileJob(job) {
    for (const frame of frameChunker(job.settings.frames, 1)) {
        const task = author.Task("frame " + frame, "misc");
        task.addCommand(author.Command("exec", {
            exe: "hexad-frame",
            args: [job.settings.spec, job.settings.output, frame],
        }));
        job.addTask(task);
    }
}
