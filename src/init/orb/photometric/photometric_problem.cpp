// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/photometric/photometric_problem.h"

#include "base/parallel.h"
#include "base/spread_frames.h"

#include <algorithm>

namespace dsorb::init_orb {
namespace {

std::vector<float> singlePrecision(const std::vector<double>& values) {
  std::vector<float> floats(values.size());
  std::transform(values.begin(), values.end(), floats.begin(), [](double value) {
    return static_cast<float>(value);
  });
  return floats;
}

}  // namespace

std::vector<std::size_t> spreadFrames(const InitialMap& map, int count) {
  std::vector<std::size_t> posed;
  for (std::size_t k = 1; k < map.frames.size(); ++k) {
    if (map.frames[k].T_cam_ref) posed.push_back(k);
  }
  if (count == 0) return posed;
  std::vector<std::size_t> spread;
  for (const std::size_t i :
       dsorb::spreadFrames(posed.size() + 1, static_cast<std::size_t>(count) + 1)) {
    spread.push_back(posed[i - 1]);
  }
  return spread;
}

PhotometricProblem makeProblem(const InitialMap& map,
                               const PinholeCamera& camera,
                               const PhotometricOptions& options,
                               const std::vector<std::size_t>& frames,
                               int level) {
  PhotometricProblem problem;
  problem.level = level;
  problem.camera = camera.atLevel(level);
  problem.brightness = options.brightness;
  problem.reference_exposure = map.frames.front().frame->exposure();
  for (const std::size_t k : frames) {
    problem.frames.push_back(
        {k, &map.frames[k].frame->level(level), map.frames[k].frame->exposure()});
  }
  const PyramidLevel& reference = map.frames.front().frame->level(level);
  const float scale = 1.0F / static_cast<float>(1 << level);
  const std::size_t corners = map.corners.size();
  const std::size_t total = corners + map.points.size();
  std::vector<std::optional<HostPatch>> patches(total);
  forEachRange(total, kPatchGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const Eigen::Vector2f pixel =
          i < corners ? map.corners[i].seen() : map.points[i - corners].pixel;
      const Eigen::Vector2f at = ((pixel.array() + 0.5F) * scale - 0.5F).matrix();
      patches[i] = readHostPatch<interpolate<float>>(reference, at);
      if (patches[i] && !options.gradient_weights) patches[i]->root_weight.fill(1);
    }
  });
  for (std::size_t i = 0; i < total; ++i) {
    if (!patches[i]) continue;
    problem.patches.push_back(*patches[i]);
    problem.source.push_back(i);
  }
  problem.seen.assign(problem.frames.size() * problem.patches.size(), 1);
  takeUnit(problem, map);
  placePatches(problem, makeState(problem, map));
  return problem;
}

PhotometricProblem makeProblem(const InitialMap& map,
                               const PinholeCamera& camera,
                               const PhotometricOptions& options) {
  return makeProblem(map, camera, options, spreadFrames(map, options.max_frames), 0);
}

std::vector<Eigen::Index> jointRows(const InitialMap& map, const PhotometricProblem& problem) {
  std::vector<Eigen::Index> rows;
  for (const PhotometricFrame& frame : problem.frames) {
    const Eigen::Index first = jointRow(map, frame.index);
    if (first < 0) return {};
    for (int d = 0; d < 6; ++d) rows.push_back(first + d);
  }
  return rows;
}

PhotometricState makeState(const PhotometricProblem& problem, const InitialMap& map) {
  PhotometricState state;
  for (const PhotometricFrame& frame : problem.frames) {
    state.T_cam_ref.push_back(*map.frames[frame.index].T_cam_ref);
    state.affine.push_back(map.frames[frame.index].affine);
  }
  const std::size_t corners = map.corners.size();
  state.inverse_depth.reserve(problem.source.size());
  for (const std::size_t i : problem.source) {
    state.inverse_depth.push_back(i < corners
                                      ? map.corners[i].inverse_depth
                                      : static_cast<double>(map.points[i - corners].inverse_depth));
  }
  return state;
}

void placePatches(PhotometricProblem& problem, const PhotometricState& state) {
  if (!problem.reference_shutter) return;
  for (std::size_t i = 0; i < problem.patches.size(); ++i) {
    HostPatch& patch = problem.patches[i];
    patch.pixel = pixelInMiddle(*problem.reference_shutter,
                                problem.camera,
                                patch.seen,
                                static_cast<float>(state.inverse_depth[i]));
  }
}

void takeUnit(PhotometricProblem& problem, const InitialMap& map) {
  problem.reference_shutter = shutterOf(map, 0, problem.level);
  for (PhotometricFrame& frame : problem.frames) {
    frame.shutter = shutterOf(map, frame.index, problem.level);
  }
  if (!map.scaleKnown()) return;
  problem.known.clear();
  const std::size_t corners = map.corners.size();
  for (const std::size_t i : problem.source) {
    problem.known.push_back(i < corners ? map.corners[i].known : map.points[i - corners].known);
  }
}

KnownTerm knownTerm(const PhotometricProblem& problem, std::size_t patch, double inverse_depth) {
  if (problem.known.empty() || !problem.known[patch]) return {};
  KnownTerm term = knownTerm(problem.known[patch], inverse_depth);
  term.hessian *= kGreyVariance;
  term.gradient *= kGreyVariance;
  term.cost *= kGreyVariance;
  term.weighted_square *= kGreyVariance;
  return term;
}

double findVisible(PhotometricProblem& problem, const PhotometricState& state) {
  const std::size_t count = problem.patches.size();
  const std::vector<float> inverse_depth = singlePrecision(state.inverse_depth);
  std::size_t visible = 0;
  for (std::size_t f = 0; f < problem.frames.size(); ++f) {
    char* seen = problem.seen.data() + f * count;
    const PatchImage image = patchImage(problem, state, f);
    forEachRange(count, kPatchGrain, [&](std::size_t begin, std::size_t end) {
      evaluatePatches(image,
                      {&problem.patches[begin], &inverse_depth[begin], nullptr, end - begin},
                      nullptr,
                      seen + begin);
    });
    visible += static_cast<std::size_t>(std::count(seen, seen + count, char{1}));
  }
  return static_cast<double>(visible) /
         static_cast<double>(std::max<std::size_t>(problem.seen.size(), 1));
}

void writeState(const PhotometricProblem& problem, const PhotometricState& state, InitialMap& map) {
  for (std::size_t f = 0; f < problem.frames.size(); ++f) {
    map.frames[problem.frames[f].index].T_cam_ref = state.T_cam_ref[f];
    map.frames[problem.frames[f].index].affine = state.affine[f];
  }
  const std::size_t corners = map.corners.size();
  for (std::size_t i = 0; i < problem.source.size(); ++i) {
    const std::size_t source = problem.source[i];
    if (source < corners) {
      map.corners[source].inverse_depth = state.inverse_depth[i];
    } else {
      map.points[source - corners].inverse_depth = static_cast<float>(state.inverse_depth[i]);
    }
  }
}

PhotometricProblem subProblem(const PhotometricProblem& problem,
                              const std::vector<std::size_t>& patches) {
  PhotometricProblem part;
  part.level = problem.level;
  part.camera = problem.camera;
  part.brightness = problem.brightness;
  part.reference_exposure = problem.reference_exposure;
  part.frames = problem.frames;
  part.reference_shutter = problem.reference_shutter;
  for (const std::size_t i : patches) {
    part.patches.push_back(problem.patches[i]);
    part.source.push_back(problem.source[i]);
    if (!problem.known.empty()) part.known.push_back(problem.known[i]);
  }
  for (std::size_t f = 0; f < problem.frames.size(); ++f) {
    for (const std::size_t i : patches) part.seen.push_back(problem.seenIn(f)[i]);
  }
  return part;
}

PatchImage patchImage(const PhotometricProblem& problem,
                      const PhotometricState& state,
                      std::size_t frame) {
  const PhotometricFrame& seen = problem.frames[frame];
  const BrightnessTransfer transfer =
      brightnessTransfer({}, problem.reference_exposure, state.affine[frame], seen.exposure);
  PatchImage image{makeTargetImage(problem.camera, state.T_cam_ref[frame], transfer, *seen.image),
                   HostRays(problem.camera),
                   problem.brightness};
  if (seen.shutter) image.target.setShutter(*seen.shutter);
  return image;
}

std::vector<FrameResiduals> residualsOf(const PhotometricProblem& problem,
                                        const PhotometricState& state) {
  const std::size_t count = problem.patches.size();
  const std::vector<float> inverse_depth = singlePrecision(state.inverse_depth);
  std::vector<FrameResiduals> residuals(problem.frames.size());
  for (std::size_t f = 0; f < residuals.size(); ++f) {
    FrameResiduals& frame = residuals[f];
    frame.values.resize(count * kPatternSize);
    frame.valid.resize(count);
    const PatchImage image = patchImage(problem, state, f);
    const char* seen = problem.seenIn(f);
    forEachRange(count, kPatchGrain, [&](std::size_t begin, std::size_t end) {
      evaluatePatches(image,
                      {&problem.patches[begin], &inverse_depth[begin], seen + begin, end - begin},
                      &frame.values[begin * kPatternSize],
                      &frame.valid[begin]);
    });
  }
  return residuals;
}

}  // namespace dsorb::init_orb
