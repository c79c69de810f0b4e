// SPDX-License-Identifier: Apache-2.0
// Written by generate.py from the OpenAPI document; do not edit.

export type Error = {
  code: string;
  message: string;
};

/** The outcome of a job or frame that has succeeded; null: it has not. */
export type Outcome = "converged" | "unresolved" | "not_converged" | null;

/**
 * Further members depend on the phase. `queue`: the attempt waits in the queue of a farm; `reason` is the
 * farm's reason.
 */
export type Progress = {
  phase: "queue" | "load" | "start" | "relax" | "measure" | "curvature" | "weights" | "write";
  /** The completed fraction of the whole attempt. */
  fraction: number;
};

export type Attempt = {
  frame?: number;
  host?: string;
  number: number;
  started: string | null;
  finished: string | null;
  exit_status?: number;
  signal?: number;
  peak_memory_bytes?: number;
  /** limits.memory_mb, or the service's default. */
  memory_limit_bytes?: number;
  /** The time in the queue of a farm, before the worker started. */
  waited_ms?: number;
  /** Processor time of the worker. */
  processor_ms?: number;
  reason?: string;
};

export type AttemptPage = {
  attempts: Attempt[];
  next: number | null;
};

export type TaskCounts = {
  all: number;
  waiting: number;
  running: number;
  succeeded: number;
  failed: number;
  cancelled: number;
  timed_out: number;
};

export type Task = {
  number: number;
  frame?: number;
  /** The name of the frame's file (`queue.files`). */
  file?: string;
  state: State;
  outcome: Outcome;
  attempt: number;
  spent: number;
  interrupted: number;
  /** The number of frames of other jobs that it waits for (`queue.after_frames`). */
  waits: number;
  not_before: string | null;
  started: string | null;
  finished: string | null;
  error: null | Error;
  notes: null | Notes;
};

/**
 * Members of report.json that a user should read before using the result. An array has none; its tasks have
 * them.
 */
export type Notes = {
  /** The number of points. Results of earlier builds lack it. */
  count?: number | null;
  /** The distance h between neighbours. Results of earlier builds lack it. */
  spacing?: number | null;
  /**
   * How regular the packing is; null for results of builds without ratings. Ratings do not affect the
   * outcome.
   */
  ratings?: {[name: string]: {
    value: number | null;
    rating: "good" | "fair" | "poor" | null;
  }} | null;
  outcome_reasons: {[name: string]: unknown}[];
  warnings: string[];
  advice: Advice;
};

/** What to change in the spec, computed from the data. */
export type Advice = {
  code: string;
  message: string;
  /** Members of the spec by their JSON Pointers, with their new values. */
  set: {[name: string]: unknown};
}[];

export type TaskPage = {
  tasks: Task[];
  next: number | null;
};

export type Event = {
  seq: number;
  at: string | null;
  job: string;
  type: string;
  state: State;
  outcome: Outcome;
  frame?: number;
  attempt?: number;
};

export type EventPage = {
  events: Event[];
  /**
   * There may be more events: send it as `after` to get them. With a filter even an empty page may have a
   * next one.
   */
  next: number | null;
  /** Where to continue later: `after` of the next request. */
  position: number;
  /** Events after `after` up to this number were removed with their jobs, so some may be missing here. */
  removed_up_to?: number;
  /**
   * The database has not reached `after`: it is older than the one that gave this number (a restored backup).
   * Continue from `position`, and read the jobs again.
   */
  reset?: true;
};

export type JobEnded = {
  type: "job.ended";
  /** When the job ended. */
  timestamp: string;
  data: {
    job: string;
    state: State;
    outcome: Outcome;
    name: string | null;
    labels: string[];
    /** The traceparent of the submission. */
    traceparent: string | null;
    delivery: null | Delivery;
    /** The name of the machine of the service. */
    host: string;
  };
};

export type Workers = {
  load: {
    attempts: number;
    attempts_limit: number;
    threads: number;
    threads_limit: number;
    memory_mb: number;
    memory_mb_limit: number;
    /** Maximum number of running attempts of each user (setting user_running); null: no maximum. */
    user_running: number | null;
  };
  workers: ({
    job: string;
    name: string | null;
    owner: string;
    frame?: number;
    /** The name of the frame's file (`queue.files`). */
    file?: string;
    attempt: number;
    started: string | null;
    threads: number;
    memory_mb: number;
    /**
     * Where the worker runs. null: it has not started, its host is not known yet, or the job belongs to
     * another user.
     */
    host: string | null;
  })[];
};

export type UsageSum = {
  /** Disk space of the files of results and of logs. */
  bytes: number;
  bytes_limit: number | null;
  /** Jobs and frames that have succeeded, failed or timed out, and are not deleted. */
  results: number;
  results_limit: number | null;
  /**
   * Uploads, with the arrived bytes of unfinished ones. A file that several users uploaded counts for each of
   * them, and once in `all`.
   */
  upload_bytes: number;
  upload_bytes_limit: number | null;
};

export type Tokens = {
  /** In the order of the token file. */
  tokens: ({
    /** The id that hexadctl token revoke takes. */
    id: string;
    user: string;
    scopes: ("read" | "submit" | "cancel" | "admin")[];
    created: string;
    /** The highest priority that the user may give. null: any. */
    max_priority: number | null;
  })[];
};

export type Usage = {
  all: UsageSum;
  /**
   * The results of all jobs have reached a limit and no job may be deleted: submissions are refused
   * (results_full).
   */
  full: boolean;
  /**
   * The users with results, and the caller if it has uploads. Sorted by size of results, largest first. The
   * limits apply to each user.
   */
  users: UsageSum & {
    user: string;
  }[];
};

export type JobSummary = {
  id: string;
  name: string | null;
  /**
   * The name of the first file of the surface, for lists; of an uploaded file the name that the caller gave
   * it. null: the job has a name, the surface has no file or one that the caller gave no name, the spec is
   * longer than 16384 characters in a list of jobs, or the job belongs to another user.
   */
  input: string | null;
  owner: string;
  revision: number;
  paused: boolean;
  /** Whether `queue.accept` contains the outcomes of all tasks. null: the job has not succeeded. */
  accepted: boolean | null;
  array: boolean;
  tasks: TaskCounts;
  threads: number;
  memory_mb: number;
  retention_s: number;
  traceparent: string | null;
  cached_from: string | null;
  state: State;
  outcome: Outcome;
  priority: number;
  labels: string[];
  created: string | null;
  started: string | null;
  finished: string | null;
  attempt: number;
  max_attempts: number;
  progress: null | Progress;
  /**
   * How many jobs of the same owner start before this one: those of a higher priority, and earlier ones of
   * the same priority; 100: or more. Owners take turns. null: the job does not wait for its turn.
   */
  ahead: number | null;
  error: null | Error;
  delivery: null | Delivery;
  links: {
    self: string;
    tasks: string;
    attempts: string;
    events: string;
    log: string;
    results?: string;
  };
};

/** A path of the spec that the setting path_mappings replaces by another one. */
export type MappedPath = {
  pointer: string;
  /** The path in the submitted spec. */
  asked: string;
  opened: string;
};

export type Job = JobSummary & {
  /** null: the caller may not see it. */
  spec: null | AnsweredSpec;
  paths: MappedPath[];
  notes: null | Notes;
  delivery: null | Delivery;
  attempts: Attempt[];
  /**
   * Only in the answer to a retry with `dependents`: the number of dependent jobs that were retried, and the
   * ids of those that were not, because they still depend on a job that failed. Jobs of other users are
   * neither retried nor listed, but for administrators.
   */
  dependents?: {
    retried: number;
    others: string[];
  };
};

/** The state of the copy of the results to output.directory. */
export type Delivery = {
  /** failed: at least one copy was not made; `POST /v1/jobs/{id}/deliver` repeats it. */
  state: "delivered" | "failed" | "pending";
  /** The error code of the first copy that failed. */
  code: string | null;
  message: string | null;
};

export type JobPage = {
  jobs: JobSummary[];
  next: string | null;
};

export type Validation = {
  spec: AnsweredSpec;
  paths: MappedPath[];
  estimate: null | Estimate;
  /** Why there is no estimate. If the answer has the header Retry-After, a later request may get one. */
  estimate_missing: string | null;
};

export type Box = {
  min: number[];
  max: number[];
};

export type Estimate = {
  /** The number of points; null when the job has a target time. */
  count: number | null;
  area: number;
  bounding_box: Box;
  memory_bytes: number;
  /**
   * The time that this number of threads takes on this machine, without writing the results; null when it is
   * unknown.
   */
  seconds: number | null;
  /** Why `seconds` is null. */
  seconds_missing: string | null;
  /**
   * The part of `seconds` for the quadrature weights of the points. Only if the job has them and `seconds` is
   * known.
   */
  weights_seconds?: number;
  threads: number;
  warnings: string[];
  advice: Advice;
};

export type Results = {
  results: {
    name: string;
    bytes: number;
    sha256: string;
    content_type: string;
    href: string;
  }[];
};

export type Input = {
  sha256: string;
  bytes: number;
  /** The path by which a spec names the file; an extension may follow. */
  path: string;
  /** The name that the caller gave the file. Other users do not see it. null: none. */
  name: string | null;
  /** When the caller sent the file first. null: the caller has not sent it, or has deleted it. */
  sent: string | null;
};

export type InputPage = {
  inputs: (Input & {
    /** The last use, by any user. The file expires `inputs_keep_s` after it. */
    used: string | null;
    /** The newest jobs of the caller that read the file. */
    jobs: string[];
    /** The number of all jobs of the caller that read the file. */
    job_count: number;
    /** The number of those that have not ended. */
    unfinished_count: number;
  })[];
  next: string | null;
};

export type FilePage = {
  path: string;
  /** The parent directory; empty: the list of roots. */
  parent: string | null;
  files: ({
    /** The name in the directory `path`; for an input root its path. */
    name: string;
    directory: boolean;
    bytes: number | null;
    modified: string | null;
  })[];
  next: string | null;
};

export type SignIn = {
  token: string;
};

export type Session = {
  /** null: an unknown caller. */
  user: string | null;
  scopes: ("read" | "submit" | "cancel" | "admin")[];
  /** When the session ends; null: the caller has none. */
  ends: string | null;
};

export type InspectionRequest = {
  /** The file, as a spec would name it. */
  path: string;
};

/** The contents of a file. The format decides which of grids, volume, channels and mesh are present. */
export type Inspection = {
  schema: "hexad.inspection";
  version: 1;
  path: string;
  bytes: number;
  format: string;
  /** The whole description as text for a terminal. */
  text: string;
  grids?: {[name: string]: unknown}[];
  volume?: {[name: string]: unknown};
  channels?: {[name: string]: unknown}[];
  stacks?: {[name: string]: unknown}[];
  images?: number;
  mesh?: {[name: string]: unknown};
  suggestions: ({
    cells?: number | null;
    measured?: boolean;
    area?: number | null;
    bounding_box?: Box;
    /** The points that resolve the surface. */
    count?: number | null;
    spacing?: number | null;
    slope?: number | null;
    warnings?: string[];
    /** Ready to be submitted. */
    spec?: AnsweredSpec;
    error?: Error;
    /** What the error is about. */
    surface?: {[name: string]: unknown};
  })[];
};

export type Health = {
  status: "ok" | "draining";
};

export type Readiness = {
  status: "ok";
  checks: Checks;
};

/** The state of each condition of readiness, in one word; `ok` when it is met. */
export type Checks = {[name: string]: string};

export type Drain = {
  status: "ok" | "draining";
  running: number;
};

export type Hold = {
  held: boolean;
  running: number;
};

export type Version = {
  name: string;
  version: string;
  api: "v1";
};

export type JsonSchema = {[name: string]: unknown};

export type Openapi = {[name: string]: unknown};

export type Problem = {
  type: string;
  title: string;
  status: number;
  detail: string;
  code: ProblemCode;
  checks?: Checks;
  /** The command that permits a user of the Unix socket, to be followed by the name of the user. */
  allow_command?: string;
  errors: {
    pointer: string;
    detail: string;
  }[];
};

/** The spec of a job. hexad-worker spec-help describes each member. */
export type JobSpec = {
  /** The version of the spec's format. */
  version: number;
  /** A descriptive name. hexad does not interpret it. */
  name?: string;
  surface: Surface;
  /**
   * Only the part of the surface inside this box, or inside another surface, is sampled. Where the box cuts
   * the surface, the surface is open and points lie along the cut. The scale of curvature still comes from
   * the bounding box of the whole surface.
   */
  region?: {
    /**
     * The surface whose inside is the region. Points are placed exactly on the cut and, as with features, on
     * the sharp edges of the sampled surface.
     */
    inside?: Surface;
    /** The lowest corner. (world) */
    min?: number[];
    /** The highest corner. It must be above the lowest corner on every axis. (world) */
    max?: number[];
  };
  /**
   * Whether points are placed exactly on the sharp edges of formulas, on the curves where parts of a
   * combination meet, and on the cuts of a region, at the requested spacing. The surface is then divided into
   * smooth patches, and mesh.ply has edges along their boundaries. For meshes, use /surface/mesh/features.
   * Default: false.
   */
  features?: boolean;
  /**
   * The number of points. Give exactly one target (count, spacing, density, control, resolve or attach) and
   * at most one rule for the spacing (alpha, curvature or grid). feature refines thin parts, and
   * curve_spacing the surface near curves; both may be combined with curvature or grid.
   */
  sampling: {
    /** The exact number of points. (points) */
    count?: number;
    /**
     * The mean distance between neighbours. The count is 2 A / (sqrt(3) spacing^2), where A is the area.
     * (world)
     */
    spacing?: number;
    /** The number of points per unit of area. (1/world^2) */
    density?: number;
    /**
     * hexagonal: the points are as regular as the surface permits. blue_noise: the points have no regular
     * order, for scattering, stippling and ray-traced sets. Their least distance is at least 0.74 spacings,
     * and no place of the surface is farther from its nearest point than 1.05 times that distance. The least
     * distance does not apply to points on opposite walls, whose normals differ by more than 113 degrees.
     * Curves have no points of their own. blue_noise requires a surface without labels and the defaults of
     * solver.method, init, energy, minimiser and sigma; excludes control, resolve, attach, alpha, points,
     * curve_spacing, features and queue.coherent. Default: "hexagonal".
     */
    pattern?: "hexagonal" | "blue_noise";
    /**
     * For reproducing the paper; otherwise use count. Finds the smallest count that is at least min_count and
     * whose support at the ideal energy is at most max_sigma (section 6.1 of the paper). Method paper starts
     * with min_count points and inserts and deletes some between rounds. Method sized computes the count from
     * sigma = sqrt(3) spacing. Works with the methods sized and paper.
     */
    control?: {
      /** The least number of points. (points) */
      min_count: number;
      /**
       * The largest support of the potential. Points are inserted until the support is small enough. (world)
       */
      max_sigma: number;
      /**
       * The number of points that paper begins with, at least min_count; 0: min_count. A number near the
       * result saves rounds. If it is too large, points are deleted. (points) Default: 0.
       */
      start_count?: number;
      /**
       * Which points are split or deleted. biased: points with little energy are more likely to be split,
       * points with much energy to be deleted. random: all points are equally likely. Only the method paper
       * inserts and deletes points. Default: "biased".
       */
      selection?: "biased" | "random";
    };
    /**
     * true, the only permitted value: hexad chooses the count that resolves the surface, from the spacing
     * that feature and grid require, at most max_spacing. The report and the estimate state the count.
     * Requires feature ("feature": {} is enough); excludes curvature. A closed mesh is then sampled on its
     * triangles, including those inside its solids, as with sharp edges (/surface/mesh/features), and
     * mesh.ply has the topology of the mesh.
     */
    resolve?: boolean;
    /**
     * The path of the points.ply of an earlier result, whose points have places on meshes (attributes: from
     * geometry, name source). The surface is then not sampled: these points are placed on its meshes, which
     * must have the same vertices and faces in the same order, such as another frame of an animation.
     * Requires a surface that is a mesh, or has one as a part; excludes all other members of sampling,
     * output.mesh, output.convergence, output.order, queue.coherent and outcome.require.
     */
    attach?: string;
    /**
     * Finer spacing where the surface is thin or opposite walls are close: at most ratio times the feature
     * size, which is half the thickness, half the gap, or the radius of a thin tube. Convex edges are not
     * thin. The job fails if the count is too small, and names the count that it needs. Requires the method
     * sized; excludes alpha.
     */
    feature?: {
      /**
       * The largest spacing, over the feature size. With 0.75, opposite walls are 2.7 spacings apart; above
       * 1, they may remain unresolved. Default: 0.75.
       */
      ratio?: number;
    };
    /**
     * Spacing by curvature with equations (13) and (14): alpha = gamma + 1 / (kappa^d + nu). kappa is
     * multiplied by a length L, so that it does not depend on scale: the longest side of the box around the
     * surface of a volume or mesh, of the domain of a formula or B-spline. The report states L. Excludes
     * feature and curve_spacing. Requires the method paper, which is then the default, or witkin-heckbert.
     */
    alpha?: {
      /**
       * The exponent. A larger one follows the curvature more strongly, one below 1 more weakly. Default: 2.
       */
      d?: number;
      /** The lower bound of alpha, which alpha approaches where the curvature is strong. Default: 0.1. */
      gamma?: number;
      /** Where the surface is flat, alpha is gamma + 1/nu. Default: 0.75. */
      nu?: number;
      /** Larger values of the scale-free curvature are replaced by this one. Default: 20. */
      kappa_max?: number;
      /**
       * The distance over which the curvature of the surface is averaged. It measures the shape instead of
       * the facets of a mesh or the noise of a scan. Give one of its members. Default: two spacings.
       */
      scale?: {
        /**
         * The distance in spacings of the even packing. 0: the curvature of the field at the point itself.
         * (spacings)
         */
        spacings?: number;
        /** The distance in world units. (world) */
        world?: number;
      };
    };
    /**
     * Spacing by curvature: finer where the surface bends. The requested spacing is scaled so that it needs
     * as many points as the target. Requires the method sized.
     */
    curvature?: {
      /**
       * Spacing sqrt(8 chord_error / max(|kappa1|, |kappa2|)): the chord between two neighbours deviates from
       * the surface by chord_error. The report states the nominal error of the count, and with output.mesh
       * the largest one of the mesh. (world)
       */
      chord_error?: number;
      /**
       * The maximum ratio of the largest to the smallest spacing. The spacing is proportional to
       * kappa^-exponent. A surface with almost uniform curvature reaches a smaller ratio. The smallest
       * spacing is used on the most curved 1 % of the area, or on as little as 1/8 % if gradation would
       * otherwise reduce the ratio below 0.8 of this value.
       */
      ratio?: number;
      /** How strongly the spacing follows the curvature. Belongs to ratio. Default: 1. */
      exponent?: number;
      /**
       * The distance over which the curvature of the surface is averaged. It measures the shape instead of
       * the facets of a mesh or the noise of a scan. Give one of its members. Default: 4 local spacings.
       */
      scale?: {
        /** The distance in local spacings. 0: the curvature at the point itself. (spacings) */
        spacings?: number;
        /** The distance in world units. (world) */
        world?: number;
      };
    };
    /**
     * Spacing from a painted map: a scalar grid of an OpenVDB file, or a value of the vertices of a mesh
     * file. The requested spacing is scaled so that it needs as many points as the target. Requires the
     * method sized.
     */
    grid?: {
      /**
       * The file: OpenVDB, or a mesh. Default: that of the surface, which then must be a grid of an OpenVDB
       * file or a mesh. Any surface may have a map in a file of its own, in world space; a mesh gives each
       * place the value of the nearest point of its triangles.
       */
      path?: string;
      /**
       * The name of the grid. If several grids have the same name, write "name[1]" for the second. Of a mesh:
       * the name of a value of its vertices, as in attributes: a property of a PLY file such as quality, an
       * array of the points of a VTK or GIfTI file, or color.
       */
      name: string;
      /**
       * The component of the value of the vertices. Of a color, 0 to 3 are red, green, blue and opacity, from
       * 0 to 1. Required if the value has several components; only for meshes.
       */
      component?: number;
      /**
       * spacing: values are distances between neighbours, above 0. density: values are points per unit of
       * area; where the density is 0, only max_spacing and gradation determine the points. Default:
       * "spacing".
       */
      kind?: "spacing" | "density";
    };
    /**
     * Points that are given, from a file. Each must be within 0.1 spacings of the surface. The target is the
     * number of all points of the result: with mode keep it includes the given ones. Requires the method
     * sized; excludes control, resolve, queue.coherent and any solver.init but surface.
     */
    points?: {
      /**
       * The file: PLY, or NPZ of NumPy with an array position or points of shape (N, 3). It must lie below
       * one of the service's input roots, or have been sent with hexadctl upload. Only the positions are
       * read, in world space.
       */
      path: string;
      /**
       * keep: the points are in the result, at the same positions and first; the other points arrange
       * themselves around them, and the attribute kept is 1 for them and 0 for the others. refine: the solve
       * starts with the points, and inserts others between them. avoid: the points are not in the result,
       * whose points keep the distance from them.
       */
      mode: "keep" | "refine" | "avoid";
      /** The least distance of the result's points from the given points. Required by mode avoid. (world) */
      distance?: number;
    };
    /**
     * The spacing of points on curves (sharp edges, boundaries of meshes, curves of features), as a fraction
     * of the spacing around them. Away from the curves it grows by gradation; the count does not change. It
     * may be combined with curvature, grid or feature. It has no effect on a surface without curves. Requires
     * the method sized; excludes alpha.
     */
    curve_spacing?: number;
    /**
     * The smallest spacing. Requires curvature, grid, feature or curve_spacing, and is refused without them.
     * feature uses no spacing below it. Default for feature: a quarter of a voxel; of a cell for a formula;
     * for a mesh with resolve, 1/256 of its longest side or a quarter of the side of its triangles, more if
     * its area is large. (world)
     */
    min_spacing?: number;
    /**
     * The largest spacing. Requires curvature, grid, feature or curve_spacing, and is refused without them.
     * At least min_spacing. (world)
     */
    max_spacing?: number;
    /**
     * The largest increase of the spacing per unit of distance along the surface. Requires curvature, grid,
     * feature or curve_spacing, and is refused without them. Default: 0.2.
     */
    gradation?: number;
  };
  /** How the points are computed. */
  solver?: {
    /**
     * paper: the particle system of Meyer, Georgel and Whitaker (2005). sized: the same system, solved from
     * coarse to fine; it leaves fewer defects in less time. witkin-heckbert: the method that the paper
     * compares itself with. It has its own Gaussian energy, splits and deletes points at any time and does
     * not reach the requested count exactly. sampling.alpha requires paper (then the default) or
     * witkin-heckbert; curvature, grid, feature and curve_spacing require sized; control requires sized or
     * paper. Default: "sized".
     */
    method?: "sized" | "paper" | "witkin-heckbert";
    /**
     * cotangent: equations (6) and (7). gaussian and electrostatic are for comparison, see section 4. The
     * standard deviation of the Gaussian is a third of the support; the electrostatic energy is cut off at
     * the support. Default: "cotangent".
     */
    energy?: "cotangent" | "gaussian" | "electrostatic";
    /**
     * lm: Levenberg-Marquardt with one lambda per particle, section 5. gradient: steepest descent (5) with a
     * fixed step, as in Table 1. Default: "lm".
     */
    minimiser?: "lm" | "gradient";
    /**
     * The step of the gradient minimiser: a factor of the force, in units of sigma^2. The cotangent energy
     * overshoots above about 0.2. Belongs to gradient. (sigma^2) Default: 0.05.
     */
    step?: number;
    /**
     * The initial support of the potential. It adapts to the count. 0: computed from count and area. (world)
     * Default: 0.
     */
    sigma?: number;
    /**
     * Parameters of the method "witkin-heckbert", with the symbols and defaults of its paper (1994). The
     * target radius, sigma_hat, follows from the sampling target.
     */
    witkin_heckbert?: {
      /**
       * alpha: the amplitude of the repulsion, E_ij = alpha exp(-r^2 / (2 sigma_i^2)). It scales the speed.
       * Default: 6.
       */
      alpha?: number;
      /**
       * E_hat divided by alpha: the energy that each particle aims at. A larger one gives a denser sampling.
       * At 0.8 neighbours are two sigma apart. Default: 0.8.
       */
      e_hat?: number;
      /** rho: how fast the radius of a particle follows its energy, dD/dt = -rho (D - E_hat). Default: 15. */
      rho?: number;
      /**
       * phi: how fast a particle returns to the surface, dF/dt = -phi F: the feedback term of (2). Default:
       * 15.
       */
      phi?: number;
      /**
       * beta: keeps the rate of a radius finite where a particle has no neighbours. In units of 1 / sigma_i;
       * the paper of 1994 uses 1 / length. Default: 10.
       */
      beta?: number;
      /**
       * Delta t: the time step of Euler's method. With the other defaults it is unstable above about 0.07.
       * (time) Default: 0.03.
       */
      dt?: number;
      /**
       * gamma: a particle slower than gamma sigma_i is near its equilibrium and may be split or deleted.
       * Default: 4.
       */
      gamma?: number;
      /**
       * nu: a particle whose radius exceeds its target is split when its energy exceeds nu E_hat. Default:
       * 0.2.
       */
      nu?: number;
      /**
       * delta: a particle may be deleted when its radius is below delta times its target radius. The smaller
       * the radius, the more likely. Default: 0.7.
       */
      delta?: number;
      /**
       * sigma_max: a particle with a larger radius is always split. 0: the larger of half the longest side of
       * the surface and 1.5 target radii. (world) Default: 0.
       */
      sigma_max?: number;
    };
    /**
     * surface: the first points are distributed over the surface by area. random: they are uniform in the
     * domain or, for volumes, in the voxels that the surface crosses. sized: a packing computed from coarse
     * to fine as by the method sized, then refined by the chosen method. Its sweeps are part of the start and
     * are not in the report. With sampling.alpha and the method paper the packing has the amplitudes; with
     * the energy cotangent, the minimiser lm and no sampling.control it is the result, and its sweeps are in
     * the report. Default: sized if sampling.alpha is given, otherwise surface. sampling.points excludes
     * random and sized. Default: "surface".
     */
    init?: "surface" | "random" | "sized";
    /** The seed of the random numbers. The same spec, seed and build give the same bytes. Default: 0. */
    seed?: number;
    /**
     * The number of threads; 0: those that the service gives to each worker. The result does not depend on
     * it. Default: 0.
     */
    threads?: number;
    /**
     * The instruction set of the numerical kernels; auto: the best one that the machine supports. The result
     * does not depend on it. Default: "auto".
     */
    isa?: "auto" | "portable" | "avx2" | "avx512";
    /** The maximum number of sweeps; the solver stops then, converged or not. (sweeps) Default: 5000. */
    max_sweeps?: number;
    /**
     * Convergence requires an rms step below this. For witkin-heckbert it is the rms displacement per unit of
     * time. Below 0.003 only a few defects still move: 0.001 doubles the sweeps and changes the quality less
     * than another seed. (spacings) Default: 0.003.
     */
    step_tolerance?: number;
    /**
     * The maximum relative difference between the mean energy of the points and the ideal one, for the
     * methods that choose the support of the energy (every method except sized). A larger difference is the
     * criterion target_energy of the outcome not_converged. Default: 0.05.
     */
    energy_tolerance?: number;
  };
  /** Requirements on the result in addition to the criteria of every job (doc/report.md). */
  outcome?: {
    /**
     * Bounds on measures of the report. A result that violates one has the outcome unresolved, with that
     * measure as the criterion.
     */
    require?: {
      /** The smallest value of quality.hex_fraction that is accepted. */
      hex_fraction?: number;
      /** The largest value of quality.edge_cv that is accepted. */
      edge_cv?: number;
      /** The largest value of quality.area_cv that is accepted. */
      area_cv?: number;
      /** The largest value of quality.energy_excess that is accepted. */
      energy_excess?: number;
      /** The largest value of quality.disorder that is accepted. */
      disorder?: number;
      /** The largest value of quality.defect_share that is accepted. */
      defect_share?: number;
      /** The smallest value of quality.min_spacing_ratio that is accepted. */
      min_spacing_ratio?: number;
      /** The largest value of quality.close_share that is accepted. */
      close_share?: number;
      /** The largest value of quality.coverage that is accepted. */
      coverage?: number;
      /** The largest value of quality.missing_share that is accepted. */
      missing_share?: number;
      /** The largest value of quality.unmeasured_share that is accepted. */
      unmeasured_share?: number;
      /** The largest value of quality.max_residual that is accepted. */
      max_residual?: number;
      /** The largest value of quality.rms_residual that is accepted. */
      rms_residual?: number;
    };
  };
  /**
   * Values from files that are interpolated at the points and written to every output, such as temperature,
   * velocity or colours. doc/formats.md lists their names in each format.
   */
  attributes?: ({
    /**
     * Where the values are. surface: in the file of the surface, of a combined surface in the first of its
     * files. geometry: in the surface itself. Anything else is the path of an OpenVDB, NRRD, NIfTI or mesh
     * file in the same space; it moves with the transforms of the surface. Default: "surface".
     */
    from?: string;
    /**
     * The grid of an OpenVDB file (any of numbers or vectors), the channel of a stack of images, the
     * component of an NRRD file with several values at a place (0, 1, ...; all of them if this is absent), or
     * the name of a value of the vertices of a mesh, or base_color: the colour of its materials and images.
     * Geometric quantities: part (the number of the part of a combined surface, from 0), direction1 or
     * direction2 (of the principal curvatures), source (the place on the mesh: source_mesh, source_face,
     * source_corner and source_bary; doc/formats.md), weight (the quadrature weight: the sum of weight times
     * f approximates the integral of f; excludes sampling.attach and given points with mode avoid).
     */
    name?: string;
    /** The name in the outputs: letters, digits and _. Default: the name, with _ for other characters. */
    as?: string;
    /**
     * The type of the values. Transforms of the surface rotate and scale vectors, rotate normals, and leave
     * other types unchanged. A color is also written as the colour of the points in each format, a uv as
     * texture coordinates. auto: int for whole numbers, vector for three components, float for others; for a
     * mesh, the type of its value. Default: "auto".
     */
    type?: "auto" | "float" | "int" | "vector" | "normal" | "color" | "uv";
    /**
     * Between the samples of a grid. cubic: Catmull and Rom's splines, which go through the samples. Whole
     * numbers are always those of the nearest sample. Default: "linear".
     */
    interpolation?: "linear" | "cubic" | "nearest";
  })[];
  /** The files to write. */
  output?: {
    /**
     * The order of the points in all outputs. progressive: the first n points are spread evenly over the
     * surface, for any n, so a program that reads the beginning of a file has a coarser sampling. spatial:
     * along Morton's curve, so points that are close in the file are close in space. id: ascending ids;
     * requires queue.coherent. Default: the order of the solver, which may differ from version to version.
     */
    order?: "progressive" | "spatial" | "id";
    /**
     * Whether the points have orient, a unit quaternion x y z w that turns +z to the normal: orient_x,
     * orient_y, orient_z and orient_w in PLY files, orient in all others. true: by the shortest turn. An
     * object can add a turn about +z before it, the twist, and replace the normal by the direction up.
     */
    orient?: boolean | {
      /**
       * The attribute, by its name in the outputs, that gives the twist: a number is an angle in radians; a
       * vector is the direction to which +x turns, as far as it is tangential.
       */
      twist?: string;
      /**
       * The twist is a random angle, computed from this seed and the id of the point (its row, unless it is a
       * point of a coherent sequence).
       */
      seed?: number;
      /**
       * The direction to which +z turns at every point, in place of the normal: [0, 0, 1] or [0, 1, 0] for
       * trees that grow straight up on a slope. Normals, if they are written, stay those of the surface.
       */
      up?: number[];
    };
    /** Options of points.ply. */
    ply?: {
      /** The encoding of points.ply. Default: "binary_little_endian". */
      format?: "binary_little_endian" | "ascii";
      /** The type of all properties of points.ply except id. Default: "float". */
      precision?: "float" | "double";
      /**
       * Which properties points.ply has, in this order; x, y and z come first. default: the normals,
       * spacing_local, spacing if the spacing is graded, the attributes, and id and velocity of coherent
       * sequences. all: all that doc/report.md lists. The name of an application: the properties that it
       * reads: blender, houdini, meshlab, or minimal (positions and normals). doc/formats.md has further
       * names. red, green and blue are those of an attribute of colours, else the colours of alpha or the
       * curvature, with the map of the preview. Without the list: default, with attach all that the points of
       * the result have.
       */
      properties?: string | string[];
    };
    /**
     * The picture preview.png. false: it is not written. true or an object: it is, and preview.exr if
     * preview_exr is true; the object has the members below.
     */
    preview?: boolean | {
      /** The side of a square image, or [width, height]. (pixels) Default: [512,512]. */
      size?: number | number[];
      /**
       * The quantity that the colours show: the amplitude alpha, the curvature kappa, the energy of a
       * particle, the achieved spacing, or the number of neighbours (degree). shading: one colour, shaded by
       * the normals; it excludes range, and map has no effect. Default: alpha if sampling.alpha is given;
       * spacing if the spacing is graded, in a sequence only with min_spacing and max_spacing, which are then
       * the range; otherwise shading.
       */
      color?: "alpha" | "curvature" | "energy" | "spacing" | "degree" | "shading";
      /**
       * The attribute that the colours show instead of color, by its name in the outputs; for a vector, its
       * length. An attribute of type color is shown unchanged. Surfaces with patches also have patch and
       * feature, labels have label_a and label_b.
       */
      attribute?: string;
      /**
       * The values at both ends of the colours, the lower one first. Requires attribute, or a color other
       * than shading. Default: the 2nd and the 98th percentile.
       */
      range?: number[];
      /**
       * The colours. diverging: from blue through nearly white, the middle of the range, to red. Default:
       * "viridis".
       */
      map?: "viridis" | "gray" | "diverging";
      /**
       * The channels of preview.exr. basic: R, G, B, A, Z and id, by which points.ply has the rest of a
       * point. all: also the place and the normal (P, N), kappa and spacing, in three times as many bytes.
       * Default: "basic".
       */
      channels?: "basic" | "all";
      /**
       * The compression of preview.exr, always without loss. At 512 x 512 pixels zip, 16 lines at once, gives
       * 0.4 to 1 MB; zips, line by line, a ninth more; rle 2 MB; none 4.2 MB (12.6 with all channels).
       * Default: "zip".
       */
      compression?: "none" | "rle" | "zips" | "zip";
      /**
       * The axis that points up unless a camera says so. auto: y for OpenVDB files and most meshes; z for
       * STL, 3MF, VTK (.vtk, .vtp) and GIfTI (.gii) meshes and all other surfaces. For an OBJ, OFF, PLY or
       * STL file, the other axis if the mesh has a flat base along that axis only. The first part of a
       * combination decides. Default: "auto".
       */
      up?: "auto" | "y" | "z";
      /**
       * The camera. Without it, the surface is seen from the right, the front and above, and fills the image.
       */
      camera?: {
        /** The position of the eye. Points behind it are not visible, also in orthographic images. (world) */
        position: number[];
        /** The point in the middle of the image. (world) */
        target: number[];
        /**
         * The direction that points up in the image; default: the axis of up. It must not be parallel to the
         * line of sight. A turntable rotates about it.
         */
        up?: number[];
        /**
         * The angle of view along the longer side of the image. 0.452 if neither fov nor orthographic is
         * given. (radians)
         */
        fov?: number;
        /** Selects parallel projection: the length that the longer side of the image shows. (world) */
        orthographic?: number;
      };
      /**
       * The number of images of one full rotation around the surface: preview.0001.png and so on; 0: none.
       * The axis is the camera's up direction through its target. Without a camera it is the axis that is up,
       * through the centre of the points. (frames) Default: 0.
       */
      turntable?: number;
    };
    /**
     * Whether to write preview.exr, beside preview.png: the picture with data in each pixel. Default: false.
     */
    preview_exr?: boolean;
    /** Whether to write convergence.csv: energy, lambda, step and count of each sweep. Default: false. */
    convergence?: boolean;
    /**
     * Whether to write points.vdb: an OpenVDB points grid with N, pscale (half the achieved spacing) and id
     * (the index of the point in points.ply, from 0). Default: false.
     */
    points_vdb?: boolean;
    /**
     * Whether to write points.npz: an array of NumPy for each property and attribute, in double precision.
     * Default: false.
     */
    points_npz?: boolean;
    /**
     * Whether to write points.vtp: VTK PolyData with each point as a vertex and an array for each property
     * and attribute, in double precision. Default: false.
     */
    points_vtp?: boolean;
    /**
     * Whether to write points.glb: the points as glTF, with normals, colours and all attributes. Default:
     * false.
     */
    points_glb?: boolean;
    /**
     * Whether to write points.usda: UsdGeomPoints as text, with widths, normals, colours and all attributes.
     * Default: false.
     */
    points_usda?: boolean;
    /** Options of points.usda. */
    usd?: {
      /**
       * points.usda has a UsdGeomPointInstancer instead of UsdGeomPoints: each point is an instance of a
       * prototype, with the orientation of output.orient (without it, the shortest turn of +z to the normal).
       * Requires points_usda.
       */
      instancer?: {
        /**
         * The path of the USD file whose default prim is the prototype, such as ./rock.usda. It is written as
         * given; programs that open points.usda resolve a relative path from its directory. hexad does not
         * open the file.
         */
        prototype: string;
        /**
         * The attribute, by its name in the outputs, that scales the prototype: a number, or a vector of
         * three components for its axes. Default: the achieved spacing at the point, so a prototype of size 1
         * is as large as the spacing.
         */
        scale?: string;
        /** A factor of all scales. Default: 1. */
        size?: number;
      };
    };
    /**
     * Whether to write mesh.ply: triangles whose vertices are the points, with the order and properties of
     * points.ply. The member mesh of the report states whether the triangles close the surface. Excludes
     * sampling.points with mode avoid. Default: false.
     */
    mesh?: boolean;
    /** Whether to write the mesh as mesh.usda, too: a UsdGeomMesh as text. Requires mesh. Default: false. */
    mesh_usda?: boolean;
    /**
     * Whether to write mesh_label_N.ply for each label N except the background: the part of the mesh that
     * bounds the label, with outward normals. Such a mesh is closed unless its label reaches the end of the
     * data, which is an interface with surface.labels.closed. Requires mesh and surface.labels. Default:
     * false.
     */
    label_meshes?: boolean;
    /**
     * The service copies the results into this directory: an absolute path below one of its output roots. It
     * is created if missing. Files of the same name are replaced. In a sequence, ####, %04d or $F4 stands for
     * the frame number.
     */
    directory?: string;
  };
  /** The resources that the job may use. 0: the default of the service or of the worker. */
  limits?: {
    /**
     * The memory of the worker; 0: the service's setting. A job that requires more for its points, grids or
     * pictures ends with limit_memory before it allocates it. If systemd has delegated a control group to the
     * service, the kernel kills a worker that uses more, also with limit_memory. Without a control group, use
     * can briefly exceed the limit: the address space is limited to this value plus 512 MiB plus 80 MiB for
     * each processor. (MiB) Default: 0.
     */
    memory_mb?: 0 | number;
    /**
     * The time that the job, or each frame of it, may run, summed over all attempts. Attempts that the
     * service itself stopped, as for a restart, do not count. (s) Default: 0.
     */
    timeout_s?: number;
    /**
     * An attempt without progress for this long is stopped, and tried again up to max_attempts. (s) Default:
     * 0.
     */
    stall_s?: number;
    /**
     * The maximum number of chunks of an OME-Zarr directory that are read. A region, or a coarser level,
     * needs fewer. (chunks) Default: 100000.
     */
    max_chunks?: number;
    /**
     * The maximum width times height of an image of a mesh (attributes: base_color). A larger one is refused
     * before it is decoded. (pixels) Default: 268435456.
     */
    image_pixels?: number;
    /**
     * The maximum number of scans of a progressive JPEG image of a mesh. Usual images have about ten; each
     * takes the time of a decoding. (scans) Default: 500.
     */
    image_scans?: number;
    /** The maximum number of attempts if the worker crashes. (attempts) Default: 0. */
    max_attempts?: number;
  };
  /** The job's place in the queue. */
  queue?: {
    /** Jobs of higher priority run first. Default: 0. */
    priority?: number;
    /** Words to search for the job by, each 1 to 100 characters long. Default: []. */
    labels?: string[];
    /**
     * Identifiers of jobs that must succeed before this one starts. If one of them does not succeed, this job
     * fails. Default: [].
     */
    depends_on?: string[];
    /** Identifiers of jobs that must end before this one starts, successful or not. Default: []. */
    after?: string[];
    /**
     * Identifiers of arrays of the same user with all frames of this job. Each frame of this job starts when
     * the same frame of these jobs has succeeded with an accepted outcome. If it ends otherwise, the frame of
     * this job fails. Requires frames. Default: [].
     */
    after_frames?: string[];
    /**
     * The outcomes of this job that its users accept; for an array, of each of its frames. A job that names
     * this one in depends_on or after_frames starts only if this job has such an outcome, and fails
     * otherwise. hexadctl wait --accept exits with 0 if the outcome is in the list. The state and the outcome
     * of the job do not change. Default: ["converged","unresolved","not_converged"].
     */
    accept?: ("converged" | "unresolved" | "not_converged")[];
    /**
     * The frame numbers; the job has one task per frame: "1-100", "1-100x2", "1-10,20". The first ####, %04d
     * or $F4 in each input path stands for the frame number. At least one input path must contain one, unless
     * by_frame is given; output.directory must contain one in any case. At most 100000 frames. "all": the
     * frames of all files of the first such path at the submission.
     */
    frames?: string;
    /**
     * Members of the spec that change from frame to frame, by JSON Pointer. Each has a list of exactly one
     * value for each frame, {"/solver/seed": [1, 2, 3]}, or a ramp, {"/surface/analytic/radius": {"from": 1,
     * "to": 2}}: linear in the frame number, from the lowest to the highest frame. Only members of surface,
     * region, sampling, solver and output may change; paths, slices, solver.threads and output.directory may
     * not. At most 10000 frames.
     */
    by_frame?: {[name: string]: unknown[] | {
      from: number;
      to: number;
    }};
    /**
     * The files of a data set; the job has one frame for each. A list of names, or a pattern such as
     * "meshes/*.ply", with * in its last part. At the submission, the service replaces a pattern by the names
     * of the files that exist below the input roots, in the order of their bytes. {file} in one input path
     * stands for the name: {"mesh": {"path": "{file}"}}. Frame k has file k, from 0. Names of uploads may be
     * listed if the path is {file}. Excludes frames, by_frame, coherent and after_frames. At most 100000
     * files; the setting max_files of the service may be lower.
     */
    files?: string | string[];
    /**
     * The maximum number of frames that run at the same time; 0: as many as the service has room for.
     * (frames) Default: 0.
     */
    max_running?: number;
    /**
     * The number of consecutive frames that run one after another, as the chunk size of render managers. Each
     * frame has limits, attempts and a result of its own. Above 1 it requires frames and excludes coherent.
     * (frames) Default: 1.
     */
    chunk?: number;
    /**
     * Whether each frame starts with the points of the frame before. The points follow the motion of the
     * surface and keep their ids. Requires frames and the method sized; excludes features, sampling.points
     * and sampling.alpha. Default: false.
     */
    coherent?: boolean;
    /** How long the job and its results are kept after its end; 0: the service's setting. (s) Default: 0. */
    retention_s?: number;
    /**
     * An http or https address that the service calls when the job has ended. The service must allow its
     * host. The service repeats the call until the answer is 2xx or the number of retries is reached. A
     * receiver may be called more than once for the same end, with the same webhook-id, and is called again
     * when a retried job ends.
     */
    webhook?: string;
    /**
     * Options of sbatch for the job's attempts, as "--partition=gpu", where the service runs them in Slurm.
     * The service must allow each (its setting slurm_allow). Default: [].
     */
    slurm?: string[];
  };
};

/** The surface to sample. Give exactly one of its members. */
export type Surface = {
  /** A scalar grid of an OpenVDB file. The surface is where the grid has the isovalue. */
  vdb?: {
    /**
     * The file. It must lie below one of the service's input roots, or have been sent with hexadctl upload.
     */
    path: string;
    /**
     * The name of the grid. If several grids have the same name, write "name[1]" for the second. Required if
     * the file has several scalar grids.
     */
    grid?: string;
    /** The value on the surface. Default for a level set: 0. Required for a fog volume. (the grid's) */
    isovalue?: number;
    /**
     * interpolating: the spline passes through the samples. smoothing: the samples are the spline's
     * coefficients; this blurs noise and moves the surface slightly. Default: "interpolating".
     */
    reconstruction?: "interpolating" | "smoothing";
  };
  /**
   * A triangle mesh. It is sampled on its triangles. A closed mesh is converted to a level set with exact
   * distances if the spec has voxel_size, resolution or on_mesh false, in offsets and combinations, and if
   * too much of its area is inside its solids.
   */
  mesh?: {
    /**
     * The file: PLY, OBJ, STL, OFF, glTF, 3MF, VTK, GIfTI, FBX or COLLADA. It must lie below one of the
     * service's input roots, or have been sent with hexadctl upload. Other files that it names are read for
     * the attribute base_color only (materials and images, below the input roots).
     */
    path: string;
    /**
     * A closed mesh is sampled through a level set of this voxel size, between 1/8191 and 1/8 of the longest
     * side of the mesh's bounding box. Excludes resolution. (world)
     */
    voxel_size?: number;
    /**
     * The number of voxels along the longest side of the bounding box of the mesh: a closed mesh is sampled
     * through a level set. If both this and voxel_size are absent and a level set is used, hexad chooses 256,
     * or more if the spacing (with resolve: min_spacing / feature.ratio) is smaller than such a voxel or more
     * than 0.5 % of the area is thinner than a voxel. At 256, at least 90 % of a scanned mesh is within 0.05
     * voxels of the sampled surface; sharp edges deviate more. Twice the number requires three to four times
     * the memory and time. (voxels)
     */
    resolution?: number;
    /**
     * The maximum resolution that hexad chooses. limits.memory_mb limits it as well: the voxels of thin parts
     * use at most an eighth of it. (voxels) Default: 4096.
     */
    max_resolution?: number;
    /**
     * The half-width of the band of distances around the mesh. Particles use four voxels on either side of
     * the surface. Three give the same surface; more than four only cost time. An offset of the mesh makes
     * the band as wide as it needs, up to 32. (voxels) Default: 4.
     */
    band_vox?: number;
    /**
     * Tolerance for joining open edges, as a fraction of the longest side of the bounding box: vertices of
     * open edges within this distance are welded, or snapped to another open edge, but at most within a tenth
     * of the shortest edge at them. 0: only vertices with equal coordinates are welded. (longest sides)
     * Default: 1e-6.
     */
    weld?: number;
    /**
     * keep: an open mesh is sampled as an open surface, with points along its boundaries. fill: holes are
     * filled; a mesh that then encloses no volume is refused. Default: "keep".
     */
    holes?: "keep" | "fill";
    /**
     * keep: all triangles are sampled, including those inside the solids of the mesh. drop: only the outside
     * of the solids is sampled, by a level set; this requires a closed mesh. auto: drop if more than 1 % of
     * the area of a closed mesh is inside it, otherwise keep. Default: "auto".
     */
    interior?: "auto" | "keep" | "drop";
    /**
     * Samples along sharp edges. If omitted, feature edges are detected automatically: meshes of planes and
     * arcs (CAD models) use an angle of 0.7; scanned meshes get no feature edges. If given for a scanned
     * mesh, sharp edges are feature edges only in chains of at least 16 edges and 4 spacings.
     */
    features?: {
      /**
       * Edges are sharp if the normals of their triangles differ by more than this. 0: no edge is sharp.
       * (radians) Default: 0.7.
       */
      angle?: number;
    };
    /**
     * true: finally each point is projected onto the nearest triangle that faces the same way. false: a
     * closed mesh is sampled through a level set without this projection. Ignored with an offset, with
     * features and for open meshes. Default: true.
     */
    on_mesh?: boolean;
  };
  /** A surface given by a formula. */
  analytic?: {
    shape: "sphere";
    /**
     * Every shape: the centre. cylinder, cone, capsule: the middle of the axis. halfspace: a point of its
     * plane. (world) Default: [0.5,0.5,0.5].
     */
    center?: number[];
    /** sphere, cylinder, capsule: the radius. cone: the radius of the base. (world) */
    radius: number;
  } | {
    shape: "torus";
    /**
     * Every shape: the centre. cylinder, cone, capsule: the middle of the axis. halfspace: a point of its
     * plane. (world) Default: [0.5,0.5,0.5].
     */
    center?: number[];
    /**
     * torus, cylinder, cone, capsule: the direction of the axis of rotation, of a cone from its base to its
     * top. halfspace: the direction out of the solid, normal to its plane. It must not be zero; its length
     * does not matter. Default: [0,0,1].
     */
    axis?: number[];
    /** torus: the distance from the centre to the middle of the tube. (world) */
    major_radius: number;
    /** torus: the radius of the tube. It must be less than major_radius. (world) */
    minor_radius: number;
  } | {
    shape: "box";
    /**
     * Every shape: the centre. cylinder, cone, capsule: the middle of the axis. halfspace: a point of its
     * plane. (world) Default: [0.5,0.5,0.5].
     */
    center?: number[];
    /** box: half of each side, including the rounding. (world) */
    half_size: number[];
    /**
     * box, cylinder: the radius of edges and corners. It must not exceed the smallest half size, of a
     * cylinder its radius and half of its height. (world) Default: 0.
     */
    rounding?: number;
  } | {
    shape: "ellipsoid";
    /**
     * Every shape: the centre. cylinder, cone, capsule: the middle of the axis. halfspace: a point of its
     * plane. (world) Default: [0.5,0.5,0.5].
     */
    center?: number[];
    /** ellipsoid: half of each axis. (world) */
    radii: number[];
  } | {
    shape: "quartic";
    /**
     * Every shape: the centre. cylinder, cone, capsule: the middle of the axis. halfspace: a point of its
     * plane. (world) Default: [0.5,0.5,0.5].
     */
    center?: number[];
    /** quartic: r in equation (15). (world) Default: 0.13. */
    r?: number;
  } | {
    shape: "gyroid";
    /**
     * Every shape: the centre. cylinder, cone, capsule: the middle of the axis. halfspace: a point of its
     * plane. (world) Default: [0.5,0.5,0.5].
     */
    center?: number[];
    /** gyroid: the sides of the box that cuts it. (world) Default: [1,1,1]. */
    size?: number[];
    /** gyroid: the length of one period. (world) */
    period: number;
  } | {
    shape: "cylinder";
    /**
     * Every shape: the centre. cylinder, cone, capsule: the middle of the axis. halfspace: a point of its
     * plane. (world) Default: [0.5,0.5,0.5].
     */
    center?: number[];
    /** sphere, cylinder, capsule: the radius. cone: the radius of the base. (world) */
    radius: number;
    /**
     * torus, cylinder, cone, capsule: the direction of the axis of rotation, of a cone from its base to its
     * top. halfspace: the direction out of the solid, normal to its plane. It must not be zero; its length
     * does not matter. Default: [0,0,1].
     */
    axis?: number[];
    /**
     * cylinder, cone: the length along the axis. capsule: the distance between the centres of its two half
     * spheres. (world)
     */
    height: number;
    /**
     * box, cylinder: the radius of edges and corners. It must not exceed the smallest half size, of a
     * cylinder its radius and half of its height. (world) Default: 0.
     */
    rounding?: number;
  } | {
    shape: "cone";
    /**
     * Every shape: the centre. cylinder, cone, capsule: the middle of the axis. halfspace: a point of its
     * plane. (world) Default: [0.5,0.5,0.5].
     */
    center?: number[];
    /** sphere, cylinder, capsule: the radius. cone: the radius of the base. (world) */
    radius: number;
    /**
     * torus, cylinder, cone, capsule: the direction of the axis of rotation, of a cone from its base to its
     * top. halfspace: the direction out of the solid, normal to its plane. It must not be zero; its length
     * does not matter. Default: [0,0,1].
     */
    axis?: number[];
    /**
     * cylinder, cone: the length along the axis. capsule: the distance between the centres of its two half
     * spheres. (world)
     */
    height: number;
    /** cone: the radius of the other end; above 0 its tip is cut off. (world) Default: 0. */
    top_radius?: number;
  } | {
    shape: "capsule";
    /**
     * Every shape: the centre. cylinder, cone, capsule: the middle of the axis. halfspace: a point of its
     * plane. (world) Default: [0.5,0.5,0.5].
     */
    center?: number[];
    /** sphere, cylinder, capsule: the radius. cone: the radius of the base. (world) */
    radius: number;
    /**
     * torus, cylinder, cone, capsule: the direction of the axis of rotation, of a cone from its base to its
     * top. halfspace: the direction out of the solid, normal to its plane. It must not be zero; its length
     * does not matter. Default: [0,0,1].
     */
    axis?: number[];
    /**
     * cylinder, cone: the length along the axis. capsule: the distance between the centres of its two half
     * spheres. (world)
     */
    height: number;
  } | {
    shape: "halfspace";
    /**
     * Every shape: the centre. cylinder, cone, capsule: the middle of the axis. halfspace: a point of its
     * plane. (world) Default: [0.5,0.5,0.5].
     */
    center?: number[];
    /**
     * torus, cylinder, cone, capsule: the direction of the axis of rotation, of a cone from its base to its
     * top. halfspace: the direction out of the solid, normal to its plane. It must not be zero; its length
     * does not matter. Default: [0,0,1].
     */
    axis?: number[];
  };
  /**
   * The zero set of a uniform cubic B-spline, given by its coefficients. Negative values are inside. Along an
   * axis with n coefficients the domain has n - 3 knot intervals of equal length w. Coefficient i, counted
   * from 0, belongs to the basis function centred on min + (i - 1) w, so the first and the last coefficient
   * lie one interval outside the domain.
   */
  bspline?: {
    /** The number of coefficients along x, y and z. */
    dims: number[];
    /** The box in which the spline is defined. */
    domain?: {
      /** The lowest corner. (world) Default: [0,0,0]. */
      min?: number[];
      /** The highest corner. It must be above the lowest corner on every axis. (world) Default: [1,1,1]. */
      max?: number[];
    };
    /** The coefficients; x varies fastest, then y. Their number is the product of dims. */
    coefficients?: number[];
    /**
     * A file that contains only the coefficients, in the same order, as little-endian floats of 32 or 64
     * bits. The file size determines which. It must lie below one of the service's input roots, or have been
     * sent with hexadctl upload.
     */
    path?: string;
  };
  /**
   * A dense volume. The surface is where the volume has the isovalue; larger values are inside. World space
   * is that of the file: for NRRD the space that the header names (left-posterior-superior is not converted),
   * for NIfTI right-anterior-superior.
   */
  volume?: {
    /**
     * The file: NRRD (raw, gzip or ascii data, attached or in separate files), NIfTI-1, NIfTI-2, MetaImage,
     * or TIFF of several pages; with slices the images of a stack, with ####, %04d or $F4 in place of the
     * slice number; or the directory of an OME-Zarr image (0.4 or 0.5). It and the files that it names must
     * lie below one of the service's input roots. A file that names no other one may instead have been sent
     * with hexadctl upload.
     */
    path: string;
    /**
     * Which volume of a file with more than three axes, counted from 0. Required if there are several. For
     * channel c at time t of a TIFF file with C channels it is c + C t.
     */
    index?: number;
    /** Which resolution of an OME-Zarr directory, counted from 0, the finest. Default: 0. */
    level?: number;
    /**
     * The path names a stack of TIFF images or of OpenEXR images with one channel, and these are its slices:
     * see /surface/exr/slices.
     */
    slices?: string;
    /**
     * The distance between samples along each axis of the data, in place of the one in the file. The
     * directions of the axes and the position of the first sample stay. Default: that of the file; for files
     * without one, 1. (world)
     */
    voxel_size?: number[];
    /** The value on the surface. The surface is open where it meets the end of the data. (the volume's) */
    isovalue: number;
    /**
     * Samples with this value have no data, as -9999 or padding: they are outside, and are read as the lowest
     * other value. Files that state such a value do not set it. (the volume's)
     */
    no_data?: number;
    /** See /surface/vdb/reconstruction. Default: "interpolating". */
    reconstruction?: "interpolating" | "smoothing";
  };
  /**
   * A segmentation: a volume of whole numbers, its labels. The surface is all interfaces between two of them,
   * each once. Points along the lines where three meet, and along the end of the data, come first. Points
   * have the properties label_a and label_b: label_a is the lower of the two labels, but a background is
   * always label_b. Normals point from label_a to label_b. It must be the whole surface: it excludes
   * combinations, offsets, transforms and region.
   */
  labels?: {
    /**
     * The file: NRRD, NIfTI, MetaImage, TIFF of several pages, OpenVDB, or the directory of an OME-Zarr
     * image; with slices the images, as in /surface/exr/path. It and the files that it names must lie below
     * one of the service's input roots. A file that names no other one may instead have been sent with
     * hexadctl upload.
     */
    path: string;
    /** See /surface/volume/index. */
    index?: number;
    /** See /surface/volume/level. */
    level?: number;
    /**
     * The labels are a stack of OpenEXR or TIFF images, and these are its slices: see /surface/exr. The same
     * holds for part, channel, voxel_size and origin; TIFF has no part and no channel.
     */
    slices?: string;
    /** The name of the part. Requires slices. */
    part?: string;
    /** The name of the channel. Requires slices. */
    channel?: string;
    /**
     * The distance between columns, rows and slices. For files with a size of their own it replaces that,
     * unless it is [1, 1, 1]. (world) Default: [1,1,1].
     */
    voxel_size?: number[];
    /** The position of pixel (0, 0) of the first slice. Requires slices. (world) Default: [0,0,0]. */
    origin?: number[];
    /** The name of the grid in an OpenVDB file. Optional if there is only one of whole numbers. */
    grid?: string;
    /** The labels to sample; all others are background. Default: all. */
    labels?: number[];
    /**
     * The cut-off wavelength of the smoothing: shorter steps are smoothed, and no vertex moves by more than
     * half a voxel along an axis. 0: no smoothing. (voxels) Default: 8.
     */
    smooth?: number;
    /**
     * Majority filter before the surface is extracted: each voxel gets the label with the most voxels around
     * it, weighted by a Gaussian with this standard deviation, in units of the smallest side of a voxel. It
     * removes steps between slices that were segmented by hand, and stray voxels. 1.5 times the spacing of
     * the points removes detail that they cannot resolve; wide filters take minutes. Weights preserve the
     * volume of each label; parts that are thinner than the rest of their label, and specks with a radius
     * below this, shrink or vanish. 0: no filter. (voxels) Default: 0.
     */
    majority?: number;
    /**
     * The background label. It is listed second in each interface, so normals point into it. Default: none; 0
     * is then a label like any other. `labels` and closed need a background: then the default is 0 if
     * `labels` is given without 0, and otherwise one less than the lowest label, at most -1.
     */
    background?: number;
    /**
     * true: beyond the end of the data is background, and the end an interface with it. false: the interfaces
     * end there. Default: false.
     */
    closed?: boolean;
    /** Labels to unite, each list under its first label: [[3, 4], [7, 8, 9]]. */
    groups?: number[][];
    /** The pairs of labels whose interfaces are sampled: [[1, 2], [2, 3]]. Default: all. */
    interfaces?: number[][];
  };
  /**
   * A stack of OpenEXR images as a dense volume. The surface is where the volume has the isovalue; larger
   * values are inside. Pixel (x, y) of slice k, counted from 0, lies at origin + voxel_size (x, y, k). Rows
   * count downwards in the image. Pixels are numbered by the data window, not by the display window. The
   * volume covers the data windows of all slices; a pixel outside the data window of its slice is 0. In tiled
   * files with levels, the full-resolution level is read. Deep images are refused.
   */
  exr?: {
    /**
     * The files, with #### (at least as many digits), %04d or $F4 in place of the slice number. They must lie
     * below one of the service's input roots.
     */
    path: string;
    /** The slices: "1-93", or every second one: "1-93x2". At least 2, at most 65536. */
    slices: string;
    /** The name of the part. Optional if only one part has the channel. */
    part?: string;
    /**
     * The name of the channel including its layer, such as "density" or "fog.Y". Optional if there is only
     * one.
     */
    channel?: string;
    /** The distance between columns, rows and slices. (world) Default: [1,1,1]. */
    voxel_size?: number[];
    /** The position of pixel (0, 0) of the first slice. (world) Default: [0,0,0]. */
    origin?: number[];
    /** The value on the surface. The surface is open where it meets the end of the data. (the channel's) */
    isovalue: number;
    /** See /surface/vdb/reconstruction. Default: "interpolating". */
    reconstruction?: "interpolating" | "smoothing";
  };
  /**
   * The union of the solids. Each member is a surface and may itself be a combination. The result has a sharp
   * edge where two surfaces meet. An empty member, such as the intersection of solids that do not overlap, is
   * skipped with a warning.
   */
  union?: Surface[];
  /** The intersection of the solids. */
  intersection?: Surface[];
  /** The first solid without the others. An empty solid among the others is skipped with a warning. */
  difference?: Surface[];
  /**
   * A surface at a constant distance from another one. The other surface must have distances: level sets,
   * meshes, and formulas except ellipsoid, quartic and gyroid; also combinations of these, and transforms
   * that preserve angles. Other surfaces, such as fog volumes, are refused. Edges of a combination stay
   * sharp. The band of a level set must be wide enough for the offset.
   */
  offset?: {
    /** The surface to offset. */
    surface: Surface;
    /** The distance. Positive is outwards, negative is inwards. (world) */
    distance: number;
  };
  /**
   * A surface transformed by a matrix: moved, rotated, mirrored, scaled or sheared. The boundaries of an open
   * surface are parallel to the world axes, so its matrix may only exchange, flip and scale axes, and
   * translate. With features, and for an open mesh, any matrix is allowed.
   */
  transform?: {
    /** The surface to transform. */
    surface: Surface;
    /** An invertible matrix as 16 numbers, row by row, for column vectors. The last row is 0, 0, 0, 1. */
    matrix: number[];
  };
};

/** The spec of a job as the service returns it, with its defaults. It can be submitted again as a JobSpec. */
export type AnsweredSpec = {
  /** The version of the spec's format. */
  version: number;
  /** A descriptive name. hexad does not interpret it. */
  name?: string;
  surface: AnsweredSurface;
  /**
   * Only the part of the surface inside this box, or inside another surface, is sampled. Where the box cuts
   * the surface, the surface is open and points lie along the cut. The scale of curvature still comes from
   * the bounding box of the whole surface.
   */
  region?: {
    /**
     * The surface whose inside is the region. Points are placed exactly on the cut and, as with features, on
     * the sharp edges of the sampled surface.
     */
    inside?: AnsweredSurface;
    /** The lowest corner. (world) */
    min?: number[];
    /** The highest corner. It must be above the lowest corner on every axis. (world) */
    max?: number[];
  };
  /**
   * Whether points are placed exactly on the sharp edges of formulas, on the curves where parts of a
   * combination meet, and on the cuts of a region, at the requested spacing. The surface is then divided into
   * smooth patches, and mesh.ply has edges along their boundaries. For meshes, use /surface/mesh/features.
   */
  features?: boolean;
  /**
   * The number of points. Give exactly one target (count, spacing, density, control, resolve or attach) and
   * at most one rule for the spacing (alpha, curvature or grid). feature refines thin parts, and
   * curve_spacing the surface near curves; both may be combined with curvature or grid.
   */
  sampling: {
    /** The exact number of points. (points) */
    count?: number;
    /**
     * The mean distance between neighbours. The count is 2 A / (sqrt(3) spacing^2), where A is the area.
     * (world)
     */
    spacing?: number;
    /** The number of points per unit of area. (1/world^2) */
    density?: number;
    /**
     * hexagonal: the points are as regular as the surface permits. blue_noise: the points have no regular
     * order, for scattering, stippling and ray-traced sets. Their least distance is at least 0.74 spacings,
     * and no place of the surface is farther from its nearest point than 1.05 times that distance. The least
     * distance does not apply to points on opposite walls, whose normals differ by more than 113 degrees.
     * Curves have no points of their own. blue_noise requires a surface without labels and the defaults of
     * solver.method, init, energy, minimiser and sigma; excludes control, resolve, attach, alpha, points,
     * curve_spacing, features and queue.coherent.
     */
    pattern?: "hexagonal" | "blue_noise";
    /**
     * For reproducing the paper; otherwise use count. Finds the smallest count that is at least min_count and
     * whose support at the ideal energy is at most max_sigma (section 6.1 of the paper). Method paper starts
     * with min_count points and inserts and deletes some between rounds. Method sized computes the count from
     * sigma = sqrt(3) spacing. Works with the methods sized and paper.
     */
    control?: {
      /** The least number of points. (points) */
      min_count: number;
      /**
       * The largest support of the potential. Points are inserted until the support is small enough. (world)
       */
      max_sigma: number;
      /**
       * The number of points that paper begins with, at least min_count; 0: min_count. A number near the
       * result saves rounds. If it is too large, points are deleted. (points)
       */
      start_count?: number;
      /**
       * Which points are split or deleted. biased: points with little energy are more likely to be split,
       * points with much energy to be deleted. random: all points are equally likely. Only the method paper
       * inserts and deletes points.
       */
      selection?: "biased" | "random";
    };
    /**
     * true, the only permitted value: hexad chooses the count that resolves the surface, from the spacing
     * that feature and grid require, at most max_spacing. The report and the estimate state the count.
     * Requires feature ("feature": {} is enough); excludes curvature. A closed mesh is then sampled on its
     * triangles, including those inside its solids, as with sharp edges (/surface/mesh/features), and
     * mesh.ply has the topology of the mesh.
     */
    resolve?: boolean;
    /**
     * The path of the points.ply of an earlier result, whose points have places on meshes (attributes: from
     * geometry, name source). The surface is then not sampled: these points are placed on its meshes, which
     * must have the same vertices and faces in the same order, such as another frame of an animation.
     * Requires a surface that is a mesh, or has one as a part; excludes all other members of sampling,
     * output.mesh, output.convergence, output.order, queue.coherent and outcome.require.
     */
    attach?: string;
    /**
     * Finer spacing where the surface is thin or opposite walls are close: at most ratio times the feature
     * size, which is half the thickness, half the gap, or the radius of a thin tube. Convex edges are not
     * thin. The job fails if the count is too small, and names the count that it needs. Requires the method
     * sized; excludes alpha.
     */
    feature?: {
      /**
       * The largest spacing, over the feature size. With 0.75, opposite walls are 2.7 spacings apart; above
       * 1, they may remain unresolved.
       */
      ratio?: number;
    };
    /**
     * Spacing by curvature with equations (13) and (14): alpha = gamma + 1 / (kappa^d + nu). kappa is
     * multiplied by a length L, so that it does not depend on scale: the longest side of the box around the
     * surface of a volume or mesh, of the domain of a formula or B-spline. The report states L. Excludes
     * feature and curve_spacing. Requires the method paper, which is then the default, or witkin-heckbert.
     */
    alpha?: {
      /** The exponent. A larger one follows the curvature more strongly, one below 1 more weakly. */
      d?: number;
      /** The lower bound of alpha, which alpha approaches where the curvature is strong. */
      gamma?: number;
      /** Where the surface is flat, alpha is gamma + 1/nu. */
      nu?: number;
      /** Larger values of the scale-free curvature are replaced by this one. */
      kappa_max?: number;
      /**
       * The distance over which the curvature of the surface is averaged. It measures the shape instead of
       * the facets of a mesh or the noise of a scan. Give one of its members. Default: two spacings.
       */
      scale?: {
        /**
         * The distance in spacings of the even packing. 0: the curvature of the field at the point itself.
         * (spacings)
         */
        spacings?: number;
        /** The distance in world units. (world) */
        world?: number;
      };
    };
    /**
     * Spacing by curvature: finer where the surface bends. The requested spacing is scaled so that it needs
     * as many points as the target. Requires the method sized.
     */
    curvature?: {
      /**
       * Spacing sqrt(8 chord_error / max(|kappa1|, |kappa2|)): the chord between two neighbours deviates from
       * the surface by chord_error. The report states the nominal error of the count, and with output.mesh
       * the largest one of the mesh. (world)
       */
      chord_error?: number;
      /**
       * The maximum ratio of the largest to the smallest spacing. The spacing is proportional to
       * kappa^-exponent. A surface with almost uniform curvature reaches a smaller ratio. The smallest
       * spacing is used on the most curved 1 % of the area, or on as little as 1/8 % if gradation would
       * otherwise reduce the ratio below 0.8 of this value.
       */
      ratio?: number;
      /** How strongly the spacing follows the curvature. Belongs to ratio. */
      exponent?: number;
      /**
       * The distance over which the curvature of the surface is averaged. It measures the shape instead of
       * the facets of a mesh or the noise of a scan. Give one of its members. Default: 4 local spacings.
       */
      scale?: {
        /** The distance in local spacings. 0: the curvature at the point itself. (spacings) */
        spacings?: number;
        /** The distance in world units. (world) */
        world?: number;
      };
    };
    /**
     * Spacing from a painted map: a scalar grid of an OpenVDB file, or a value of the vertices of a mesh
     * file. The requested spacing is scaled so that it needs as many points as the target. Requires the
     * method sized.
     */
    grid?: {
      /**
       * The file: OpenVDB, or a mesh. Default: that of the surface, which then must be a grid of an OpenVDB
       * file or a mesh. Any surface may have a map in a file of its own, in world space; a mesh gives each
       * place the value of the nearest point of its triangles.
       */
      path?: string;
      /**
       * The name of the grid. If several grids have the same name, write "name[1]" for the second. Of a mesh:
       * the name of a value of its vertices, as in attributes: a property of a PLY file such as quality, an
       * array of the points of a VTK or GIfTI file, or color.
       */
      name: string;
      /**
       * The component of the value of the vertices. Of a color, 0 to 3 are red, green, blue and opacity, from
       * 0 to 1. Required if the value has several components; only for meshes.
       */
      component?: number;
      /**
       * spacing: values are distances between neighbours, above 0. density: values are points per unit of
       * area; where the density is 0, only max_spacing and gradation determine the points.
       */
      kind?: "spacing" | "density";
    };
    /**
     * Points that are given, from a file. Each must be within 0.1 spacings of the surface. The target is the
     * number of all points of the result: with mode keep it includes the given ones. Requires the method
     * sized; excludes control, resolve, queue.coherent and any solver.init but surface.
     */
    points?: {
      /**
       * The file: PLY, or NPZ of NumPy with an array position or points of shape (N, 3). It must lie below
       * one of the service's input roots, or have been sent with hexadctl upload. Only the positions are
       * read, in world space.
       */
      path: string;
      /**
       * keep: the points are in the result, at the same positions and first; the other points arrange
       * themselves around them, and the attribute kept is 1 for them and 0 for the others. refine: the solve
       * starts with the points, and inserts others between them. avoid: the points are not in the result,
       * whose points keep the distance from them.
       */
      mode: "keep" | "refine" | "avoid";
      /** The least distance of the result's points from the given points. Required by mode avoid. (world) */
      distance?: number;
    };
    /**
     * The spacing of points on curves (sharp edges, boundaries of meshes, curves of features), as a fraction
     * of the spacing around them. Away from the curves it grows by gradation; the count does not change. It
     * may be combined with curvature, grid or feature. It has no effect on a surface without curves. Requires
     * the method sized; excludes alpha.
     */
    curve_spacing?: number;
    /**
     * The smallest spacing. Requires curvature, grid, feature or curve_spacing, and is refused without them.
     * feature uses no spacing below it. Default for feature: a quarter of a voxel; of a cell for a formula;
     * for a mesh with resolve, 1/256 of its longest side or a quarter of the side of its triangles, more if
     * its area is large. (world)
     */
    min_spacing?: number;
    /**
     * The largest spacing. Requires curvature, grid, feature or curve_spacing, and is refused without them.
     * At least min_spacing. (world)
     */
    max_spacing?: number;
    /**
     * The largest increase of the spacing per unit of distance along the surface. Requires curvature, grid,
     * feature or curve_spacing, and is refused without them.
     */
    gradation?: number;
  };
  /** How the points are computed. */
  solver?: {
    /**
     * paper: the particle system of Meyer, Georgel and Whitaker (2005). sized: the same system, solved from
     * coarse to fine; it leaves fewer defects in less time. witkin-heckbert: the method that the paper
     * compares itself with. It has its own Gaussian energy, splits and deletes points at any time and does
     * not reach the requested count exactly. sampling.alpha requires paper (then the default) or
     * witkin-heckbert; curvature, grid, feature and curve_spacing require sized; control requires sized or
     * paper.
     */
    method?: "sized" | "paper" | "witkin-heckbert";
    /**
     * cotangent: equations (6) and (7). gaussian and electrostatic are for comparison, see section 4. The
     * standard deviation of the Gaussian is a third of the support; the electrostatic energy is cut off at
     * the support.
     */
    energy?: "cotangent" | "gaussian" | "electrostatic";
    /**
     * lm: Levenberg-Marquardt with one lambda per particle, section 5. gradient: steepest descent (5) with a
     * fixed step, as in Table 1.
     */
    minimiser?: "lm" | "gradient";
    /**
     * The step of the gradient minimiser: a factor of the force, in units of sigma^2. The cotangent energy
     * overshoots above about 0.2. Belongs to gradient. (sigma^2)
     */
    step?: number;
    /**
     * The initial support of the potential. It adapts to the count. 0: computed from count and area. (world)
     */
    sigma?: number;
    /**
     * Parameters of the method "witkin-heckbert", with the symbols and defaults of its paper (1994). The
     * target radius, sigma_hat, follows from the sampling target.
     */
    witkin_heckbert?: {
      /**
       * alpha: the amplitude of the repulsion, E_ij = alpha exp(-r^2 / (2 sigma_i^2)). It scales the speed.
       */
      alpha?: number;
      /**
       * E_hat divided by alpha: the energy that each particle aims at. A larger one gives a denser sampling.
       * At 0.8 neighbours are two sigma apart.
       */
      e_hat?: number;
      /** rho: how fast the radius of a particle follows its energy, dD/dt = -rho (D - E_hat). */
      rho?: number;
      /** phi: how fast a particle returns to the surface, dF/dt = -phi F: the feedback term of (2). */
      phi?: number;
      /**
       * beta: keeps the rate of a radius finite where a particle has no neighbours. In units of 1 / sigma_i;
       * the paper of 1994 uses 1 / length.
       */
      beta?: number;
      /**
       * Delta t: the time step of Euler's method. With the other defaults it is unstable above about 0.07.
       * (time)
       */
      dt?: number;
      /** gamma: a particle slower than gamma sigma_i is near its equilibrium and may be split or deleted. */
      gamma?: number;
      /** nu: a particle whose radius exceeds its target is split when its energy exceeds nu E_hat. */
      nu?: number;
      /**
       * delta: a particle may be deleted when its radius is below delta times its target radius. The smaller
       * the radius, the more likely.
       */
      delta?: number;
      /**
       * sigma_max: a particle with a larger radius is always split. 0: the larger of half the longest side of
       * the surface and 1.5 target radii. (world)
       */
      sigma_max?: number;
    };
    /**
     * surface: the first points are distributed over the surface by area. random: they are uniform in the
     * domain or, for volumes, in the voxels that the surface crosses. sized: a packing computed from coarse
     * to fine as by the method sized, then refined by the chosen method. Its sweeps are part of the start and
     * are not in the report. With sampling.alpha and the method paper the packing has the amplitudes; with
     * the energy cotangent, the minimiser lm and no sampling.control it is the result, and its sweeps are in
     * the report. Default: sized if sampling.alpha is given, otherwise surface. sampling.points excludes
     * random and sized.
     */
    init?: "surface" | "random" | "sized";
    /** The seed of the random numbers. The same spec, seed and build give the same bytes. */
    seed?: number;
    /**
     * The number of threads; 0: those that the service gives to each worker. The result does not depend on
     * it.
     */
    threads?: number;
    /**
     * The instruction set of the numerical kernels; auto: the best one that the machine supports. The result
     * does not depend on it.
     */
    isa?: "auto" | "portable" | "avx2" | "avx512";
    /** The maximum number of sweeps; the solver stops then, converged or not. (sweeps) */
    max_sweeps?: number;
    /**
     * Convergence requires an rms step below this. For witkin-heckbert it is the rms displacement per unit of
     * time. Below 0.003 only a few defects still move: 0.001 doubles the sweeps and changes the quality less
     * than another seed. (spacings)
     */
    step_tolerance?: number;
    /**
     * The maximum relative difference between the mean energy of the points and the ideal one, for the
     * methods that choose the support of the energy (every method except sized). A larger difference is the
     * criterion target_energy of the outcome not_converged.
     */
    energy_tolerance?: number;
  };
  /** Requirements on the result in addition to the criteria of every job (doc/report.md). */
  outcome?: {
    /**
     * Bounds on measures of the report. A result that violates one has the outcome unresolved, with that
     * measure as the criterion.
     */
    require?: {
      /** The smallest value of quality.hex_fraction that is accepted. */
      hex_fraction?: number;
      /** The largest value of quality.edge_cv that is accepted. */
      edge_cv?: number;
      /** The largest value of quality.area_cv that is accepted. */
      area_cv?: number;
      /** The largest value of quality.energy_excess that is accepted. */
      energy_excess?: number;
      /** The largest value of quality.disorder that is accepted. */
      disorder?: number;
      /** The largest value of quality.defect_share that is accepted. */
      defect_share?: number;
      /** The smallest value of quality.min_spacing_ratio that is accepted. */
      min_spacing_ratio?: number;
      /** The largest value of quality.close_share that is accepted. */
      close_share?: number;
      /** The largest value of quality.coverage that is accepted. */
      coverage?: number;
      /** The largest value of quality.missing_share that is accepted. */
      missing_share?: number;
      /** The largest value of quality.unmeasured_share that is accepted. */
      unmeasured_share?: number;
      /** The largest value of quality.max_residual that is accepted. */
      max_residual?: number;
      /** The largest value of quality.rms_residual that is accepted. */
      rms_residual?: number;
    };
  };
  /**
   * Values from files that are interpolated at the points and written to every output, such as temperature,
   * velocity or colours. doc/formats.md lists their names in each format.
   */
  attributes?: ({
    /**
     * Where the values are. surface: in the file of the surface, of a combined surface in the first of its
     * files. geometry: in the surface itself. Anything else is the path of an OpenVDB, NRRD, NIfTI or mesh
     * file in the same space; it moves with the transforms of the surface.
     */
    from?: string;
    /**
     * The grid of an OpenVDB file (any of numbers or vectors), the channel of a stack of images, the
     * component of an NRRD file with several values at a place (0, 1, ...; all of them if this is absent), or
     * the name of a value of the vertices of a mesh, or base_color: the colour of its materials and images.
     * Geometric quantities: part (the number of the part of a combined surface, from 0), direction1 or
     * direction2 (of the principal curvatures), source (the place on the mesh: source_mesh, source_face,
     * source_corner and source_bary; doc/formats.md), weight (the quadrature weight: the sum of weight times
     * f approximates the integral of f; excludes sampling.attach and given points with mode avoid).
     */
    name?: string;
    /** The name in the outputs: letters, digits and _. Default: the name, with _ for other characters. */
    as?: string;
    /**
     * The type of the values. Transforms of the surface rotate and scale vectors, rotate normals, and leave
     * other types unchanged. A color is also written as the colour of the points in each format, a uv as
     * texture coordinates. auto: int for whole numbers, vector for three components, float for others; for a
     * mesh, the type of its value.
     */
    type?: "auto" | "float" | "int" | "vector" | "normal" | "color" | "uv";
    /**
     * Between the samples of a grid. cubic: Catmull and Rom's splines, which go through the samples. Whole
     * numbers are always those of the nearest sample.
     */
    interpolation?: "linear" | "cubic" | "nearest";
  })[];
  /** The files to write. */
  output?: {
    /**
     * The order of the points in all outputs. progressive: the first n points are spread evenly over the
     * surface, for any n, so a program that reads the beginning of a file has a coarser sampling. spatial:
     * along Morton's curve, so points that are close in the file are close in space. id: ascending ids;
     * requires queue.coherent. Default: the order of the solver, which may differ from version to version.
     */
    order?: "progressive" | "spatial" | "id";
    /**
     * Whether the points have orient, a unit quaternion x y z w that turns +z to the normal: orient_x,
     * orient_y, orient_z and orient_w in PLY files, orient in all others. true: by the shortest turn. An
     * object can add a turn about +z before it, the twist, and replace the normal by the direction up.
     */
    orient?: boolean | {
      /**
       * The attribute, by its name in the outputs, that gives the twist: a number is an angle in radians; a
       * vector is the direction to which +x turns, as far as it is tangential.
       */
      twist?: string;
      /**
       * The twist is a random angle, computed from this seed and the id of the point (its row, unless it is a
       * point of a coherent sequence).
       */
      seed?: number;
      /**
       * The direction to which +z turns at every point, in place of the normal: [0, 0, 1] or [0, 1, 0] for
       * trees that grow straight up on a slope. Normals, if they are written, stay those of the surface.
       */
      up?: number[];
    };
    /** Options of points.ply. */
    ply?: {
      /** The encoding of points.ply. */
      format?: "binary_little_endian" | "ascii";
      /** The type of all properties of points.ply except id. */
      precision?: "float" | "double";
      /**
       * Which properties points.ply has, in this order; x, y and z come first. default: the normals,
       * spacing_local, spacing if the spacing is graded, the attributes, and id and velocity of coherent
       * sequences. all: all that doc/report.md lists. The name of an application: the properties that it
       * reads: blender, houdini, meshlab, or minimal (positions and normals). doc/formats.md has further
       * names. red, green and blue are those of an attribute of colours, else the colours of alpha or the
       * curvature, with the map of the preview. Without the list: default, with attach all that the points of
       * the result have.
       */
      properties?: string | string[];
    };
    /**
     * The picture preview.png. false: it is not written. true or an object: it is, and preview.exr if
     * preview_exr is true; the object has the members below.
     */
    preview?: boolean | {
      /** The side of a square image, or [width, height]. (pixels) */
      size?: number | number[];
      /**
       * The quantity that the colours show: the amplitude alpha, the curvature kappa, the energy of a
       * particle, the achieved spacing, or the number of neighbours (degree). shading: one colour, shaded by
       * the normals; it excludes range, and map has no effect. Default: alpha if sampling.alpha is given;
       * spacing if the spacing is graded, in a sequence only with min_spacing and max_spacing, which are then
       * the range; otherwise shading.
       */
      color?: "alpha" | "curvature" | "energy" | "spacing" | "degree" | "shading";
      /**
       * The attribute that the colours show instead of color, by its name in the outputs; for a vector, its
       * length. An attribute of type color is shown unchanged. Surfaces with patches also have patch and
       * feature, labels have label_a and label_b.
       */
      attribute?: string;
      /**
       * The values at both ends of the colours, the lower one first. Requires attribute, or a color other
       * than shading. Default: the 2nd and the 98th percentile.
       */
      range?: number[];
      /** The colours. diverging: from blue through nearly white, the middle of the range, to red. */
      map?: "viridis" | "gray" | "diverging";
      /**
       * The channels of preview.exr. basic: R, G, B, A, Z and id, by which points.ply has the rest of a
       * point. all: also the place and the normal (P, N), kappa and spacing, in three times as many bytes.
       */
      channels?: "basic" | "all";
      /**
       * The compression of preview.exr, always without loss. At 512 x 512 pixels zip, 16 lines at once, gives
       * 0.4 to 1 MB; zips, line by line, a ninth more; rle 2 MB; none 4.2 MB (12.6 with all channels).
       */
      compression?: "none" | "rle" | "zips" | "zip";
      /**
       * The axis that points up unless a camera says so. auto: y for OpenVDB files and most meshes; z for
       * STL, 3MF, VTK (.vtk, .vtp) and GIfTI (.gii) meshes and all other surfaces. For an OBJ, OFF, PLY or
       * STL file, the other axis if the mesh has a flat base along that axis only. The first part of a
       * combination decides.
       */
      up?: "auto" | "y" | "z";
      /**
       * The camera. Without it, the surface is seen from the right, the front and above, and fills the image.
       */
      camera?: {
        /** The position of the eye. Points behind it are not visible, also in orthographic images. (world) */
        position: number[];
        /** The point in the middle of the image. (world) */
        target: number[];
        /**
         * The direction that points up in the image; default: the axis of up. It must not be parallel to the
         * line of sight. A turntable rotates about it.
         */
        up?: number[];
        /**
         * The angle of view along the longer side of the image. 0.452 if neither fov nor orthographic is
         * given. (radians)
         */
        fov?: number;
        /** Selects parallel projection: the length that the longer side of the image shows. (world) */
        orthographic?: number;
      };
      /**
       * The number of images of one full rotation around the surface: preview.0001.png and so on; 0: none.
       * The axis is the camera's up direction through its target. Without a camera it is the axis that is up,
       * through the centre of the points. (frames)
       */
      turntable?: number;
    };
    /** Whether to write preview.exr, beside preview.png: the picture with data in each pixel. */
    preview_exr?: boolean;
    /** Whether to write convergence.csv: energy, lambda, step and count of each sweep. */
    convergence?: boolean;
    /**
     * Whether to write points.vdb: an OpenVDB points grid with N, pscale (half the achieved spacing) and id
     * (the index of the point in points.ply, from 0).
     */
    points_vdb?: boolean;
    /**
     * Whether to write points.npz: an array of NumPy for each property and attribute, in double precision.
     */
    points_npz?: boolean;
    /**
     * Whether to write points.vtp: VTK PolyData with each point as a vertex and an array for each property
     * and attribute, in double precision.
     */
    points_vtp?: boolean;
    /** Whether to write points.glb: the points as glTF, with normals, colours and all attributes. */
    points_glb?: boolean;
    /**
     * Whether to write points.usda: UsdGeomPoints as text, with widths, normals, colours and all attributes.
     */
    points_usda?: boolean;
    /** Options of points.usda. */
    usd?: {
      /**
       * points.usda has a UsdGeomPointInstancer instead of UsdGeomPoints: each point is an instance of a
       * prototype, with the orientation of output.orient (without it, the shortest turn of +z to the normal).
       * Requires points_usda.
       */
      instancer?: {
        /**
         * The path of the USD file whose default prim is the prototype, such as ./rock.usda. It is written as
         * given; programs that open points.usda resolve a relative path from its directory. hexad does not
         * open the file.
         */
        prototype: string;
        /**
         * The attribute, by its name in the outputs, that scales the prototype: a number, or a vector of
         * three components for its axes. Default: the achieved spacing at the point, so a prototype of size 1
         * is as large as the spacing.
         */
        scale?: string;
        /** A factor of all scales. */
        size?: number;
      };
    };
    /**
     * Whether to write mesh.ply: triangles whose vertices are the points, with the order and properties of
     * points.ply. The member mesh of the report states whether the triangles close the surface. Excludes
     * sampling.points with mode avoid.
     */
    mesh?: boolean;
    /** Whether to write the mesh as mesh.usda, too: a UsdGeomMesh as text. Requires mesh. */
    mesh_usda?: boolean;
    /**
     * Whether to write mesh_label_N.ply for each label N except the background: the part of the mesh that
     * bounds the label, with outward normals. Such a mesh is closed unless its label reaches the end of the
     * data, which is an interface with surface.labels.closed. Requires mesh and surface.labels.
     */
    label_meshes?: boolean;
    /**
     * The service copies the results into this directory: an absolute path below one of its output roots. It
     * is created if missing. Files of the same name are replaced. In a sequence, ####, %04d or $F4 stands for
     * the frame number.
     */
    directory?: string;
  };
  /** The resources that the job may use. 0: the default of the service or of the worker. */
  limits?: {
    /**
     * The memory of the worker; 0: the service's setting. A job that requires more for its points, grids or
     * pictures ends with limit_memory before it allocates it. If systemd has delegated a control group to the
     * service, the kernel kills a worker that uses more, also with limit_memory. Without a control group, use
     * can briefly exceed the limit: the address space is limited to this value plus 512 MiB plus 80 MiB for
     * each processor. (MiB)
     */
    memory_mb?: 0 | number;
    /**
     * The time that the job, or each frame of it, may run, summed over all attempts. Attempts that the
     * service itself stopped, as for a restart, do not count. (s)
     */
    timeout_s?: number;
    /** An attempt without progress for this long is stopped, and tried again up to max_attempts. (s) */
    stall_s?: number;
    /**
     * The maximum number of chunks of an OME-Zarr directory that are read. A region, or a coarser level,
     * needs fewer. (chunks)
     */
    max_chunks?: number;
    /**
     * The maximum width times height of an image of a mesh (attributes: base_color). A larger one is refused
     * before it is decoded. (pixels)
     */
    image_pixels?: number;
    /**
     * The maximum number of scans of a progressive JPEG image of a mesh. Usual images have about ten; each
     * takes the time of a decoding. (scans)
     */
    image_scans?: number;
    /** The maximum number of attempts if the worker crashes. (attempts) */
    max_attempts?: number;
  };
  /** The job's place in the queue. */
  queue?: {
    /** Jobs of higher priority run first. */
    priority?: number;
    /** Words to search for the job by, each 1 to 100 characters long. */
    labels?: string[];
    /**
     * Identifiers of jobs that must succeed before this one starts. If one of them does not succeed, this job
     * fails.
     */
    depends_on?: string[];
    /** Identifiers of jobs that must end before this one starts, successful or not. */
    after?: string[];
    /**
     * Identifiers of arrays of the same user with all frames of this job. Each frame of this job starts when
     * the same frame of these jobs has succeeded with an accepted outcome. If it ends otherwise, the frame of
     * this job fails. Requires frames.
     */
    after_frames?: string[];
    /**
     * The outcomes of this job that its users accept; for an array, of each of its frames. A job that names
     * this one in depends_on or after_frames starts only if this job has such an outcome, and fails
     * otherwise. hexadctl wait --accept exits with 0 if the outcome is in the list. The state and the outcome
     * of the job do not change.
     */
    accept?: ("converged" | "unresolved" | "not_converged")[];
    /**
     * The frame numbers; the job has one task per frame: "1-100", "1-100x2", "1-10,20". The first ####, %04d
     * or $F4 in each input path stands for the frame number. At least one input path must contain one, unless
     * by_frame is given; output.directory must contain one in any case. At most 100000 frames. "all": the
     * frames of all files of the first such path at the submission.
     */
    frames?: string;
    /**
     * Members of the spec that change from frame to frame, by JSON Pointer. Each has a list of exactly one
     * value for each frame, {"/solver/seed": [1, 2, 3]}, or a ramp, {"/surface/analytic/radius": {"from": 1,
     * "to": 2}}: linear in the frame number, from the lowest to the highest frame. Only members of surface,
     * region, sampling, solver and output may change; paths, slices, solver.threads and output.directory may
     * not. At most 10000 frames.
     */
    by_frame?: {[name: string]: unknown[] | {
      from: number;
      to: number;
    }};
    /**
     * The files of a data set; the job has one frame for each. A list of names, or a pattern such as
     * "meshes/*.ply", with * in its last part. At the submission, the service replaces a pattern by the names
     * of the files that exist below the input roots, in the order of their bytes. {file} in one input path
     * stands for the name: {"mesh": {"path": "{file}"}}. Frame k has file k, from 0. Names of uploads may be
     * listed if the path is {file}. Excludes frames, by_frame, coherent and after_frames. At most 100000
     * files; the setting max_files of the service may be lower.
     */
    files?: string | string[];
    /**
     * The maximum number of frames that run at the same time; 0: as many as the service has room for.
     * (frames)
     */
    max_running?: number;
    /**
     * The number of consecutive frames that run one after another, as the chunk size of render managers. Each
     * frame has limits, attempts and a result of its own. Above 1 it requires frames and excludes coherent.
     * (frames)
     */
    chunk?: number;
    /**
     * Whether each frame starts with the points of the frame before. The points follow the motion of the
     * surface and keep their ids. Requires frames and the method sized; excludes features, sampling.points
     * and sampling.alpha.
     */
    coherent?: boolean;
    /** How long the job and its results are kept after its end; 0: the service's setting. (s) */
    retention_s?: number;
    /**
     * An http or https address that the service calls when the job has ended. The service must allow its
     * host. The service repeats the call until the answer is 2xx or the number of retries is reached. A
     * receiver may be called more than once for the same end, with the same webhook-id, and is called again
     * when a retried job ends.
     */
    webhook?: string;
    /**
     * Options of sbatch for the job's attempts, as "--partition=gpu", where the service runs them in Slurm.
     * The service must allow each (its setting slurm_allow).
     */
    slurm?: string[];
  };
};

/** The surface to sample. Give exactly one of its members. */
export type AnsweredSurface = {
  /** A scalar grid of an OpenVDB file. The surface is where the grid has the isovalue. */
  vdb?: {
    /**
     * The file. It must lie below one of the service's input roots, or have been sent with hexadctl upload.
     */
    path: string;
    /**
     * The name of the grid. If several grids have the same name, write "name[1]" for the second. Required if
     * the file has several scalar grids.
     */
    grid?: string;
    /** The value on the surface. Default for a level set: 0. Required for a fog volume. (the grid's) */
    isovalue?: number;
    /**
     * interpolating: the spline passes through the samples. smoothing: the samples are the spline's
     * coefficients; this blurs noise and moves the surface slightly.
     */
    reconstruction?: "interpolating" | "smoothing";
  };
  /**
   * A triangle mesh. It is sampled on its triangles. A closed mesh is converted to a level set with exact
   * distances if the spec has voxel_size, resolution or on_mesh false, in offsets and combinations, and if
   * too much of its area is inside its solids.
   */
  mesh?: {
    /**
     * The file: PLY, OBJ, STL, OFF, glTF, 3MF, VTK, GIfTI, FBX or COLLADA. It must lie below one of the
     * service's input roots, or have been sent with hexadctl upload. Other files that it names are read for
     * the attribute base_color only (materials and images, below the input roots).
     */
    path: string;
    /**
     * A closed mesh is sampled through a level set of this voxel size, between 1/8191 and 1/8 of the longest
     * side of the mesh's bounding box. Excludes resolution. (world)
     */
    voxel_size?: number;
    /**
     * The number of voxels along the longest side of the bounding box of the mesh: a closed mesh is sampled
     * through a level set. If both this and voxel_size are absent and a level set is used, hexad chooses 256,
     * or more if the spacing (with resolve: min_spacing / feature.ratio) is smaller than such a voxel or more
     * than 0.5 % of the area is thinner than a voxel. At 256, at least 90 % of a scanned mesh is within 0.05
     * voxels of the sampled surface; sharp edges deviate more. Twice the number requires three to four times
     * the memory and time. (voxels)
     */
    resolution?: number;
    /**
     * The maximum resolution that hexad chooses. limits.memory_mb limits it as well: the voxels of thin parts
     * use at most an eighth of it. (voxels)
     */
    max_resolution?: number;
    /**
     * The half-width of the band of distances around the mesh. Particles use four voxels on either side of
     * the surface. Three give the same surface; more than four only cost time. An offset of the mesh makes
     * the band as wide as it needs, up to 32. (voxels)
     */
    band_vox?: number;
    /**
     * Tolerance for joining open edges, as a fraction of the longest side of the bounding box: vertices of
     * open edges within this distance are welded, or snapped to another open edge, but at most within a tenth
     * of the shortest edge at them. 0: only vertices with equal coordinates are welded. (longest sides)
     */
    weld?: number;
    /**
     * keep: an open mesh is sampled as an open surface, with points along its boundaries. fill: holes are
     * filled; a mesh that then encloses no volume is refused.
     */
    holes?: "keep" | "fill";
    /**
     * keep: all triangles are sampled, including those inside the solids of the mesh. drop: only the outside
     * of the solids is sampled, by a level set; this requires a closed mesh. auto: drop if more than 1 % of
     * the area of a closed mesh is inside it, otherwise keep.
     */
    interior?: "auto" | "keep" | "drop";
    /**
     * Samples along sharp edges. If omitted, feature edges are detected automatically: meshes of planes and
     * arcs (CAD models) use an angle of 0.7; scanned meshes get no feature edges. If given for a scanned
     * mesh, sharp edges are feature edges only in chains of at least 16 edges and 4 spacings.
     */
    features?: {
      /**
       * Edges are sharp if the normals of their triangles differ by more than this. 0: no edge is sharp.
       * (radians)
       */
      angle?: number;
    };
    /**
     * true: finally each point is projected onto the nearest triangle that faces the same way. false: a
     * closed mesh is sampled through a level set without this projection. Ignored with an offset, with
     * features and for open meshes.
     */
    on_mesh?: boolean;
  };
  /** A surface given by a formula. */
  analytic?: {
    shape: "sphere";
    /**
     * Every shape: the centre. cylinder, cone, capsule: the middle of the axis. halfspace: a point of its
     * plane. (world)
     */
    center?: number[];
    /** sphere, cylinder, capsule: the radius. cone: the radius of the base. (world) */
    radius: number;
  } | {
    shape: "torus";
    /**
     * Every shape: the centre. cylinder, cone, capsule: the middle of the axis. halfspace: a point of its
     * plane. (world)
     */
    center?: number[];
    /**
     * torus, cylinder, cone, capsule: the direction of the axis of rotation, of a cone from its base to its
     * top. halfspace: the direction out of the solid, normal to its plane. It must not be zero; its length
     * does not matter.
     */
    axis?: number[];
    /** torus: the distance from the centre to the middle of the tube. (world) */
    major_radius: number;
    /** torus: the radius of the tube. It must be less than major_radius. (world) */
    minor_radius: number;
  } | {
    shape: "box";
    /**
     * Every shape: the centre. cylinder, cone, capsule: the middle of the axis. halfspace: a point of its
     * plane. (world)
     */
    center?: number[];
    /** box: half of each side, including the rounding. (world) */
    half_size: number[];
    /**
     * box, cylinder: the radius of edges and corners. It must not exceed the smallest half size, of a
     * cylinder its radius and half of its height. (world)
     */
    rounding?: number;
  } | {
    shape: "ellipsoid";
    /**
     * Every shape: the centre. cylinder, cone, capsule: the middle of the axis. halfspace: a point of its
     * plane. (world)
     */
    center?: number[];
    /** ellipsoid: half of each axis. (world) */
    radii: number[];
  } | {
    shape: "quartic";
    /**
     * Every shape: the centre. cylinder, cone, capsule: the middle of the axis. halfspace: a point of its
     * plane. (world)
     */
    center?: number[];
    /** quartic: r in equation (15). (world) */
    r?: number;
  } | {
    shape: "gyroid";
    /**
     * Every shape: the centre. cylinder, cone, capsule: the middle of the axis. halfspace: a point of its
     * plane. (world)
     */
    center?: number[];
    /** gyroid: the sides of the box that cuts it. (world) */
    size?: number[];
    /** gyroid: the length of one period. (world) */
    period: number;
  } | {
    shape: "cylinder";
    /**
     * Every shape: the centre. cylinder, cone, capsule: the middle of the axis. halfspace: a point of its
     * plane. (world)
     */
    center?: number[];
    /** sphere, cylinder, capsule: the radius. cone: the radius of the base. (world) */
    radius: number;
    /**
     * torus, cylinder, cone, capsule: the direction of the axis of rotation, of a cone from its base to its
     * top. halfspace: the direction out of the solid, normal to its plane. It must not be zero; its length
     * does not matter.
     */
    axis?: number[];
    /**
     * cylinder, cone: the length along the axis. capsule: the distance between the centres of its two half
     * spheres. (world)
     */
    height: number;
    /**
     * box, cylinder: the radius of edges and corners. It must not exceed the smallest half size, of a
     * cylinder its radius and half of its height. (world)
     */
    rounding?: number;
  } | {
    shape: "cone";
    /**
     * Every shape: the centre. cylinder, cone, capsule: the middle of the axis. halfspace: a point of its
     * plane. (world)
     */
    center?: number[];
    /** sphere, cylinder, capsule: the radius. cone: the radius of the base. (world) */
    radius: number;
    /**
     * torus, cylinder, cone, capsule: the direction of the axis of rotation, of a cone from its base to its
     * top. halfspace: the direction out of the solid, normal to its plane. It must not be zero; its length
     * does not matter.
     */
    axis?: number[];
    /**
     * cylinder, cone: the length along the axis. capsule: the distance between the centres of its two half
     * spheres. (world)
     */
    height: number;
    /** cone: the radius of the other end; above 0 its tip is cut off. (world) */
    top_radius?: number;
  } | {
    shape: "capsule";
    /**
     * Every shape: the centre. cylinder, cone, capsule: the middle of the axis. halfspace: a point of its
     * plane. (world)
     */
    center?: number[];
    /** sphere, cylinder, capsule: the radius. cone: the radius of the base. (world) */
    radius: number;
    /**
     * torus, cylinder, cone, capsule: the direction of the axis of rotation, of a cone from its base to its
     * top. halfspace: the direction out of the solid, normal to its plane. It must not be zero; its length
     * does not matter.
     */
    axis?: number[];
    /**
     * cylinder, cone: the length along the axis. capsule: the distance between the centres of its two half
     * spheres. (world)
     */
    height: number;
  } | {
    shape: "halfspace";
    /**
     * Every shape: the centre. cylinder, cone, capsule: the middle of the axis. halfspace: a point of its
     * plane. (world)
     */
    center?: number[];
    /**
     * torus, cylinder, cone, capsule: the direction of the axis of rotation, of a cone from its base to its
     * top. halfspace: the direction out of the solid, normal to its plane. It must not be zero; its length
     * does not matter.
     */
    axis?: number[];
  };
  /**
   * The zero set of a uniform cubic B-spline, given by its coefficients. Negative values are inside. Along an
   * axis with n coefficients the domain has n - 3 knot intervals of equal length w. Coefficient i, counted
   * from 0, belongs to the basis function centred on min + (i - 1) w, so the first and the last coefficient
   * lie one interval outside the domain.
   */
  bspline?: {
    /** The number of coefficients along x, y and z. */
    dims: number[];
    /** The box in which the spline is defined. */
    domain?: {
      /** The lowest corner. (world) */
      min?: number[];
      /** The highest corner. It must be above the lowest corner on every axis. (world) */
      max?: number[];
    };
    /** The coefficients; x varies fastest, then y. Their number is the product of dims. */
    coefficients?: number[];
    /**
     * A file that contains only the coefficients, in the same order, as little-endian floats of 32 or 64
     * bits. The file size determines which. It must lie below one of the service's input roots, or have been
     * sent with hexadctl upload.
     */
    path?: string;
  };
  /**
   * A dense volume. The surface is where the volume has the isovalue; larger values are inside. World space
   * is that of the file: for NRRD the space that the header names (left-posterior-superior is not converted),
   * for NIfTI right-anterior-superior.
   */
  volume?: {
    /**
     * The file: NRRD (raw, gzip or ascii data, attached or in separate files), NIfTI-1, NIfTI-2, MetaImage,
     * or TIFF of several pages; with slices the images of a stack, with ####, %04d or $F4 in place of the
     * slice number; or the directory of an OME-Zarr image (0.4 or 0.5). It and the files that it names must
     * lie below one of the service's input roots. A file that names no other one may instead have been sent
     * with hexadctl upload.
     */
    path: string;
    /**
     * Which volume of a file with more than three axes, counted from 0. Required if there are several. For
     * channel c at time t of a TIFF file with C channels it is c + C t.
     */
    index?: number;
    /** Which resolution of an OME-Zarr directory, counted from 0, the finest. Default: 0. */
    level?: number;
    /**
     * The path names a stack of TIFF images or of OpenEXR images with one channel, and these are its slices:
     * see /surface/exr/slices.
     */
    slices?: string;
    /**
     * The distance between samples along each axis of the data, in place of the one in the file. The
     * directions of the axes and the position of the first sample stay. Default: that of the file; for files
     * without one, 1. (world)
     */
    voxel_size?: number[];
    /** The value on the surface. The surface is open where it meets the end of the data. (the volume's) */
    isovalue: number;
    /**
     * Samples with this value have no data, as -9999 or padding: they are outside, and are read as the lowest
     * other value. Files that state such a value do not set it. (the volume's)
     */
    no_data?: number;
    /** See /surface/vdb/reconstruction. */
    reconstruction?: "interpolating" | "smoothing";
  };
  /**
   * A segmentation: a volume of whole numbers, its labels. The surface is all interfaces between two of them,
   * each once. Points along the lines where three meet, and along the end of the data, come first. Points
   * have the properties label_a and label_b: label_a is the lower of the two labels, but a background is
   * always label_b. Normals point from label_a to label_b. It must be the whole surface: it excludes
   * combinations, offsets, transforms and region.
   */
  labels?: {
    /**
     * The file: NRRD, NIfTI, MetaImage, TIFF of several pages, OpenVDB, or the directory of an OME-Zarr
     * image; with slices the images, as in /surface/exr/path. It and the files that it names must lie below
     * one of the service's input roots. A file that names no other one may instead have been sent with
     * hexadctl upload.
     */
    path: string;
    /** See /surface/volume/index. */
    index?: number;
    /** See /surface/volume/level. */
    level?: number;
    /**
     * The labels are a stack of OpenEXR or TIFF images, and these are its slices: see /surface/exr. The same
     * holds for part, channel, voxel_size and origin; TIFF has no part and no channel.
     */
    slices?: string;
    /** The name of the part. Requires slices. */
    part?: string;
    /** The name of the channel. Requires slices. */
    channel?: string;
    /**
     * The distance between columns, rows and slices. For files with a size of their own it replaces that,
     * unless it is [1, 1, 1]. (world)
     */
    voxel_size?: number[];
    /** The position of pixel (0, 0) of the first slice. Requires slices. (world) */
    origin?: number[];
    /** The name of the grid in an OpenVDB file. Optional if there is only one of whole numbers. */
    grid?: string;
    /** The labels to sample; all others are background. Default: all. */
    labels?: number[];
    /**
     * The cut-off wavelength of the smoothing: shorter steps are smoothed, and no vertex moves by more than
     * half a voxel along an axis. 0: no smoothing. (voxels)
     */
    smooth?: number;
    /**
     * Majority filter before the surface is extracted: each voxel gets the label with the most voxels around
     * it, weighted by a Gaussian with this standard deviation, in units of the smallest side of a voxel. It
     * removes steps between slices that were segmented by hand, and stray voxels. 1.5 times the spacing of
     * the points removes detail that they cannot resolve; wide filters take minutes. Weights preserve the
     * volume of each label; parts that are thinner than the rest of their label, and specks with a radius
     * below this, shrink or vanish. 0: no filter. (voxels)
     */
    majority?: number;
    /**
     * The background label. It is listed second in each interface, so normals point into it. Default: none; 0
     * is then a label like any other. `labels` and closed need a background: then the default is 0 if
     * `labels` is given without 0, and otherwise one less than the lowest label, at most -1.
     */
    background?: number;
    /**
     * true: beyond the end of the data is background, and the end an interface with it. false: the interfaces
     * end there.
     */
    closed?: boolean;
    /** Labels to unite, each list under its first label: [[3, 4], [7, 8, 9]]. */
    groups?: number[][];
    /** The pairs of labels whose interfaces are sampled: [[1, 2], [2, 3]]. Default: all. */
    interfaces?: number[][];
  };
  /**
   * A stack of OpenEXR images as a dense volume. The surface is where the volume has the isovalue; larger
   * values are inside. Pixel (x, y) of slice k, counted from 0, lies at origin + voxel_size (x, y, k). Rows
   * count downwards in the image. Pixels are numbered by the data window, not by the display window. The
   * volume covers the data windows of all slices; a pixel outside the data window of its slice is 0. In tiled
   * files with levels, the full-resolution level is read. Deep images are refused.
   */
  exr?: {
    /**
     * The files, with #### (at least as many digits), %04d or $F4 in place of the slice number. They must lie
     * below one of the service's input roots.
     */
    path: string;
    /** The slices: "1-93", or every second one: "1-93x2". At least 2, at most 65536. */
    slices: string;
    /** The name of the part. Optional if only one part has the channel. */
    part?: string;
    /**
     * The name of the channel including its layer, such as "density" or "fog.Y". Optional if there is only
     * one.
     */
    channel?: string;
    /** The distance between columns, rows and slices. (world) */
    voxel_size?: number[];
    /** The position of pixel (0, 0) of the first slice. (world) */
    origin?: number[];
    /** The value on the surface. The surface is open where it meets the end of the data. (the channel's) */
    isovalue: number;
    /** See /surface/vdb/reconstruction. */
    reconstruction?: "interpolating" | "smoothing";
  };
  /**
   * The union of the solids. Each member is a surface and may itself be a combination. The result has a sharp
   * edge where two surfaces meet. An empty member, such as the intersection of solids that do not overlap, is
   * skipped with a warning.
   */
  union?: AnsweredSurface[];
  /** The intersection of the solids. */
  intersection?: AnsweredSurface[];
  /** The first solid without the others. An empty solid among the others is skipped with a warning. */
  difference?: AnsweredSurface[];
  /**
   * A surface at a constant distance from another one. The other surface must have distances: level sets,
   * meshes, and formulas except ellipsoid, quartic and gyroid; also combinations of these, and transforms
   * that preserve angles. Other surfaces, such as fog volumes, are refused. Edges of a combination stay
   * sharp. The band of a level set must be wide enough for the offset.
   */
  offset?: {
    /** The surface to offset. */
    surface: AnsweredSurface;
    /** The distance. Positive is outwards, negative is inwards. (world) */
    distance: number;
  };
  /**
   * A surface transformed by a matrix: moved, rotated, mirrored, scaled or sheared. The boundaries of an open
   * surface are parallel to the world axes, so its matrix may only exchange, flip and scale axes, and
   * translate. With features, and for an open mesh, any matrix is allowed.
   */
  transform?: {
    /** The surface to transform. */
    surface: AnsweredSurface;
    /** An invertible matrix as 16 numbers, row by row, for column vectors. The last row is 0, 0, 0, 1. */
    matrix: number[];
  };
};

export type JobPatch = {
  /** Jobs of higher priority run first. Default: 0. */
  priority?: number;
  /** Words to search for the job by, each 1 to 100 characters long. Default: []. */
  labels?: string[];
  /** How long the job and its results are kept after its end; 0: the service's setting. (s) Default: 0. */
  retention_s?: number;
  /**
   * The outcomes of this job that its users accept; for an array, of each of its frames. A job that names
   * this one in depends_on or after_frames starts only if this job has such an outcome, and fails otherwise.
   * hexadctl wait --accept exits with 0 if the outcome is in the list. The state and the outcome of the job
   * do not change. Default: ["converged","unresolved","not_converged"].
   */
  accept?: ("converged" | "unresolved" | "not_converged")[];
  /**
   * The maximum number of frames that run at the same time; 0: as many as the service has room for. (frames)
   * Default: 0.
   */
  max_running?: number;
};

export type State = "queued" | "blocked" | "paused" | "running" | "cancelling" | "succeeded" | "failed" | "cancelled" | "timed_out";

export type ProblemCode = "json_invalid" | "request_invalid" | "unauthorized" | "forbidden" | "origin_forbidden" | "path_forbidden" | "not_found" | "method_not_allowed" | "conflict" | "gone" | "output_taken" | "precondition_failed" | "body_too_large" | "media_type_unsupported" | "range_not_satisfiable" | "misdirected_request" | "idempotency_mismatch" | "digest_mismatch" | "spec_invalid" | "not_supported" | "input_missing" | "input_unsupported" | "input_damaged" | "grid_missing" | "attribute_missing" | "grid_ambiguous" | "isovalue_required" | "no_surface" | "too_many_requests" | "unavailable" | "database_damaged" | "state_lost" | "output_unwritable" | "limit_memory" | "too_many_jobs" | "too_many_tasks" | "results_full" | "too_many_submissions" | "priority_forbidden" | "storage_full" | "internal";

/** The requests of the service by their names in the OpenAPI document: what each needs, and its answer. */
export interface Operations {
  /** Submit a job. Needs the scope `submit`. */
  submitJob: {
    parameters: {
      /**
       * An identifier of this request. A repeated request with the same body creates no second job; with
       * another body it is refused. A key belongs to its user and is valid until the job is deleted.
       */
      "Idempotency-Key"?: string;
      /**
       * wait=SECONDS: the answer waits until the job has ended or, with If-None-Match, has changed, for at
       * most SECONDS and at most the setting wait_limit_s. Preference-Applied in the answer has the time that
       * was used.
       */
      Prefer?: string;
      /**
       * W3C Trace Context. It is stored with the job and goes into the logs, the environment of the worker
       * (TRACEPARENT) and webhooks.
       */
      traceparent?: string;
      body: JobSpec;
    };
    answer: Job;
  };
  /** List jobs, by default the newest first. Needs the scope `read`. */
  listJobs: {
    parameters: {
      /** Only jobs in this state, or in one of these: `queued,running`. */
      state?: State[];
      /** Only jobs of this user, or their events. */
      owner?: string;
      /** Only jobs with this label, or their events. */
      label?: string;
      /**
       * The name of a result, as in the list of results; of a list of jobs: only those of this name; of an
       * upload: the name of the file, which only its sender sees.
       */
      name?: string;
      /** Only jobs with this text in their name; the case of ASCII letters does not matter. */
      text?: string;
      /**
       * Only jobs whose `queue.depends_on` or `queue.after` contains this ID: those of the caller, or for an
       * administrator those of all users.
       */
      depends_on?: string;
      /**
       * Only jobs that were submitted at this time or later: RFC 3339, such as 2026-01-31T18:00:00Z, or with
       * another offset; without an offset, or as a date, UTC.
       */
      created_after?: string;
      /** Only jobs that were submitted before this time. */
      created_before?: string;
      /**
       * The sort key of the list, over all its pages: ascending, or descending with a minus. Names are
       * compared without regard to the case of ASCII letters. Jobs with equal keys are sorted by age, the
       * newest first with a minus.
       */
      sort?: "-created" | "created" | "-name" | "name" | "-owner" | "owner" | "-state" | "state" | "-priority" | "priority";
      /**
       * The maximum number of entries of a page. A page of jobs or events examines at most 4096 entries and
       * may be short or empty before the list ends: the list ends when `next` is null.
       */
      limit?: number;
      /** `next` of the previous page; of jobs with the same `sort`. */
      cursor?: string;
    };
    answer: JobPage;
  };
  /** Check a spec without submitting it, and estimate its cost. Needs the scope `read`. */
  validateJob: {
    parameters: {
      /**
       * The time limit of the estimate in milliseconds. A client that submits the spec next uses it to detect
       * faults quickly. Default: the setting estimate_timeout_s.
       */
      within_ms?: number;
      body: JobSpec;
    };
    answer: Validation;
  };
  /** Get a job. Needs the scope `read`. */
  getJob: {
    parameters: {
      /** The id of a job. */
      id: string;
      /** The known ETag: the answer is 304 if it is still valid. */
      "If-None-Match"?: string;
      /**
       * wait=SECONDS: the answer waits until the job has ended or, with If-None-Match, has changed, for at
       * most SECONDS and at most the setting wait_limit_s. Preference-Applied in the answer has the time that
       * was used.
       */
      Prefer?: string;
    };
    answer: Job | null;
  };
  /** Change the priority, labels or retention of a job. Needs the scope `cancel`. */
  editJob: {
    parameters: {
      /** The id of a job. */
      id: string;
      /** The ETag of the job: it changes only if it still has this ETag. */
      "If-Match"?: string;
      body: JobPatch;
    };
    answer: Job;
  };
  /** Delete a job that has ended, with its results. Needs the scope `cancel`. */
  deleteJob: {
    parameters: {
      /** The id of a job. */
      id: string;
    };
    answer: null;
  };
  /** Cancel a job. Needs the scope `cancel`. */
  cancelJob: {
    parameters: {
      /** The id of a job. */
      id: string;
    };
    answer: Job;
  };
  /** Pause a job: no attempt starts until it is resumed. Needs the scope `cancel`. */
  pauseJob: {
    parameters: {
      /** The id of a job. */
      id: string;
    };
    answer: Job;
  };
  /** Resume a paused job. Needs the scope `cancel`. */
  resumeJob: {
    parameters: {
      /** The id of a job. */
      id: string;
    };
    answer: Job;
  };
  /** Run the failed tasks of an ended job again. Needs the scope `cancel`. */
  retryJob: {
    parameters: {
      /** The id of a job. */
      id: string;
      /**
       * 1: also the jobs that ended as dependency_failed because of this one, directly or indirectly, if the
       * caller may retry them.
       */
      dependents?: number;
      /**
       * wait=SECONDS: the answer waits until the job has ended or, with If-None-Match, has changed, for at
       * most SECONDS and at most the setting wait_limit_s. Preference-Applied in the answer has the time that
       * was used.
       */
      Prefer?: string;
    };
    answer: Job;
  };
  /** Copy the results of an ended job to its output directory again. Needs the scope `submit`. */
  deliverJob: {
    parameters: {
      /** The id of a job. */
      id: string;
    };
    answer: Job;
  };
  /** List the tasks of a job. Needs the scope `read`. */
  listTasks: {
    parameters: {
      /** The id of a job. */
      id: string;
      /**
       * `next` or `position` of the previous page: the list continues after it. 0: from the oldest entry.
       * Without it `/v1/events` begins now, and other lists at their beginning.
       */
      after?: number;
      /**
       * The maximum number of entries of a page. A page of jobs or events examines at most 4096 entries and
       * may be short or empty before the list ends: the list ends when `next` is null.
       */
      limit?: number;
    };
    answer: TaskPage;
  };
  /** List the attempts of a job. Needs the scope `read`. */
  listAttempts: {
    parameters: {
      /** The id of a job. */
      id: string;
      /**
       * `next` or `position` of the previous page: the list continues after it. 0: from the oldest entry.
       * Without it `/v1/events` begins now, and other lists at their beginning.
       */
      after?: number;
      /**
       * The maximum number of entries of a page. A page of jobs or events examines at most 4096 entries and
       * may be short or empty before the list ends: the list ends when `next` is null.
       */
      limit?: number;
    };
    answer: AttemptPage;
  };
  /** Get the log of an attempt. Needs the scope `read`. */
  getLog: {
    parameters: {
      /** The id of a job. */
      id: string;
      /** The frame of an array job. */
      frame?: number;
      /** The number of the attempt. Default: the last one. */
      attempt?: number;
    };
    answer: string;
  };
  /** Get at most 20 000 points of a running job, as PLY. Needs the scope `read`. */
  getSnapshot: {
    parameters: {
      /** The id of a job. */
      id: string;
      /** The frame of an array job. */
      frame?: number;
    };
    answer: Uint8Array;
  };
  /** Get the events of a job, as pages or as a stream. Needs the scope `read`. */
  followJob: {
    parameters: {
      /** The id of a job. */
      id: string;
      /**
       * `next` or `position` of the previous page: the list continues after it. 0: from the oldest entry.
       * Without it `/v1/events` begins now, and other lists at their beginning.
       */
      after?: number;
      /**
       * The maximum number of entries of a page. A page of jobs or events examines at most 4096 entries and
       * may be short or empty before the list ends: the list ends when `next` is null.
       */
      limit?: number;
      /**
       * The id of the last received event: the stream continues after it. It takes precedence over the
       * parameter `after`.
       */
      "Last-Event-ID"?: string;
    };
    answer: EventPage | null;
  };
  /**
   * Follow the events of the caller's jobs from now on; with all=1, or for an administrator, of all jobs.
   * Needs the scope `read`.
   */
  followJobs: {
    parameters: {
      /**
       * `next` or `position` of the previous page: the list continues after it. 0: from the oldest entry.
       * Without it `/v1/events` begins now, and other lists at their beginning.
       */
      after?: number;
      /** Only events of the job with this id. */
      job?: string;
      /** Only jobs of this user, or their events. */
      owner?: string;
      /** Only jobs with this label, or their events. */
      label?: string;
      /**
       * The maximum number of entries of a page. A page of jobs or events examines at most 4096 entries and
       * may be short or empty before the list ends: the list ends when `next` is null.
       */
      limit?: number;
      /**
       * 1: the stream has the progress of running attempts of the caller's jobs as well, whatever the label
       * of these jobs; for an administrator of all jobs.
       */
      progress?: number;
      /**
       * 1: the events of the jobs of all users; of an upload, as an administrator: delete it for all users,
       * at once.
       */
      all?: number;
      /**
       * The id of the last received event: the stream continues after it. It takes precedence over the
       * parameter `after`.
       */
      "Last-Event-ID"?: string;
    };
    answer: EventPage;
  };
  /** List the results of a job. Needs the scope `read`. */
  listResults: {
    parameters: {
      /** The id of a job. */
      id: string;
      /** The frame of an array job. */
      frame?: number;
    };
    answer: Results;
  };
  /** Get a result, or a part of it. Needs the scope `read`. */
  getResult: {
    parameters: {
      /** The id of a job. */
      id: string;
      /**
       * The name of a result, as in the list of results; of a list of jobs: only those of this name; of an
       * upload: the name of the file, which only its sender sees.
       */
      name: string;
      /** The frame of an array job. */
      frame?: number;
      /** bytes=FIRST-LAST: a part of the file. */
      Range?: string;
      /** The ETag that Range refers to: with another ETag the whole file is sent. */
      "If-Range"?: string;
      /** The known ETag: the answer is 304 if it is still valid. */
      "If-None-Match"?: string;
    };
    answer: Uint8Array | null;
  };
  /**
   * Get the preview of a job, or of the first frame of an array that succeeded, reduced to at most 128 x 128
   * pixels. Needs the scope `read`.
   */
  getThumbnail: {
    parameters: {
      /** The id of a job. */
      id: string;
      /** The frame of an array job. */
      frame?: number;
      /** The known ETag: the answer is 304 if it is still valid. */
      "If-None-Match"?: string;
    };
    answer: Uint8Array | null;
  };
  /** Removed: the thumbnails of the frames have their previews. Needs the scope `read`. */
  getContactSheet: {
    parameters: {
      /** The id of a job. */
      id: string;
    };
    answer: null;
  };
  /** Get the space that results take, of all users and of each, and the bounds. Needs the scope `read`. */
  getUsage: {
    parameters: {};
    answer: Usage;
  };
  /** List the running attempts, and the limits. Needs the scope `read`. */
  listWorkers: {
    parameters: {};
    answer: Workers;
  };
  /** List the tokens, without their values. Needs the scope `admin`. */
  listTokens: {
    parameters: {};
    answer: Tokens;
  };
  /** Upload a file that jobs may read. Needs the scope `submit`. */
  putInput: {
    parameters: {
      /** The SHA-256 of the file: 64 hexadecimal digits in lower case. */
      sha256: string;
      /**
       * The name of a result, as in the list of results; of a list of jobs: only those of this name; of an
       * upload: the name of the file, which only its sender sees.
       */
      name?: string;
      body: Uint8Array;
    };
    answer: Input;
  };
  /** Get whether an input exists. Needs the scope `read`. */
  getInput: {
    parameters: {
      /** The SHA-256 of the file: 64 hexadecimal digits in lower case. */
      sha256: string;
    };
    answer: Input;
  };
  /**
   * Delete an upload of the caller. The file is removed when no user holds it and no unfinished job reads it.
   * Needs the scope `submit`.
   */
  deleteInput: {
    parameters: {
      /** The SHA-256 of the file: 64 hexadecimal digits in lower case. */
      sha256: string;
      /**
       * 1: the events of the jobs of all users; of an upload, as an administrator: delete it for all users,
       * at once.
       */
      all?: number;
    };
    answer: null;
  };
  /** List the uploads of the caller, the one that was sent last first. Needs the scope `read`. */
  listInputs: {
    parameters: {
      /**
       * The maximum number of entries of a page. A page of jobs or events examines at most 4096 entries and
       * may be short or empty before the list ends: the list ends when `next` is null.
       */
      limit?: number;
      /** `next` of the previous page; of jobs with the same `sort`. */
      cursor?: string;
    };
    answer: InputPage;
  };
  /** Describe a file that jobs may read, with specs that sample it. Needs the scope `submit`. */
  inspectInput: {
    parameters: {
      body: InspectionRequest;
    };
    answer: Inspection;
  };
  /** List a directory of the input roots, or the roots, by name. Needs the scope `submit`. */
  listFiles: {
    parameters: {
      /** A directory below an input root. Without it, or empty: the roots themselves. */
      path?: string;
      /**
       * The maximum number of entries of a page. A page of jobs or events examines at most 4096 entries and
       * may be short or empty before the list ends: the list ends when `next` is null.
       */
      limit?: number;
      /** `next` of the previous page; of jobs with the same `sort`. */
      cursor?: string;
    };
    answer: FilePage;
  };
  /** Accept no more jobs and start no attempts; running ones continue. Needs the scope `admin`. */
  drain: {
    parameters: {};
    answer: Drain;
  };
  /** End a drain. Needs the scope `admin`. */
  resume: {
    parameters: {};
    answer: Drain;
  };
  /** Accept jobs but start no attempts, until a release; running ones continue. Needs the scope `admin`. */
  hold: {
    parameters: {};
    answer: Hold;
  };
  /** End a hold. Needs the scope `admin`. */
  release: {
    parameters: {};
    answer: Hold;
  };
  /** Get a copy of the database as a backup. Needs the scope `admin`. */
  getBackup: {
    parameters: {};
    answer: Uint8Array;
  };
  /** Begin the session of a browser with a token; the answer sets a cookie. */
  signIn: {
    parameters: {
      body: SignIn;
    };
    answer: Session;
  };
  /** Get the caller and its scopes. */
  getSession: {
    parameters: {};
    answer: Session;
  };
  /** End the session of a browser. */
  signOut: {
    parameters: {};
    answer: null;
  };
  /** Get the web page. */
  getPage: {
    parameters: {
      /** The known ETag: the answer is 304 if it is still valid. */
      "If-None-Match"?: string;
    };
    answer: Uint8Array | null;
  };
  /** Get a file of the web page. */
  getPageFile: {
    parameters: {
      /**
       * The name of a result, as in the list of results; of a list of jobs: only those of this name; of an
       * upload: the name of the file, which only its sender sees.
       */
      name: string;
      /** The known ETag: the answer is 304 if it is still valid. */
      "If-None-Match"?: string;
    };
    answer: Uint8Array | null;
  };
  /** Get the JSON Schema of specs, with the defaults. */
  getSchema: {
    parameters: {
      /** The known ETag: the answer is 304 if it is still valid. */
      "If-None-Match"?: string;
    };
    answer: JsonSchema | null;
  };
  /** Get this document. */
  getOpenapi: {
    parameters: {
      /** The known ETag: the answer is 304 if it is still valid. */
      "If-None-Match"?: string;
    };
    answer: Openapi | null;
  };
  /** Get whether the service runs. */
  getHealth: {
    parameters: {};
    answer: Health;
  };
  /** Get whether the service accepts jobs. */
  getReadiness: {
    parameters: {};
    answer: Readiness;
  };
  /** Get metrics for Prometheus. Needs the scope `read`. */
  getMetrics: {
    parameters: {};
    answer: string;
  };
  /** Get the version of the service. */
  getVersion: {
    parameters: {};
    answer: Version;
  };
}

export interface Route {
  method: string;
  /** With {name} for the parameters in it. */
  path: string;
  /** The parameters that are header fields. */
  headers: string[];
  /** The media type of the body. */
  body: string | null;
  answer: "json" | "text" | "bytes" | "nothing";
}
export const operations: {[name in keyof Operations]: Route};
