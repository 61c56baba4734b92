// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/outlier_filter.h"

#include "init/orb/photometric_problem.h"
#include "init/orb/residual_statistics.h"

#include <algorithm>
#include <cmath>

namespace dsorb::init_orb {
namespace {

/// Every pixel of every patch that takes part in a frame.
std::vector<double> pixelsOf(const FrameResiduals& patches) {
  std::vector<double> pixels;
  pixels.reserve(patches.size() * kPatternSize);
  for (const auto& patch : patches) {
    if (patch) pixels.insert(pixels.end(), patch->data(), patch->data() + kPatternSize);
  }
  return pixels;
}

/// By patch: whether it is to go.
using Verdicts = std::vector<char>;

Verdicts votePixels(const PhotometricProblem& problem,
                    const std::vector<FrameResiduals>& residuals,
                    const OutlierOptions& options,
                    OutlierReport& report) {
  std::vector<int> remaining(problem.patches.size(), 0);
  std::vector<double> scales;
  for (const FrameResiduals& frame : residuals) {
    const double scale = fitTDistribution(pixelsOf(frame), options.prefilter).scale;
    scales.push_back(scale);
    const double cut = options.t_quantile * scale;
    for (std::size_t i = 0; i < frame.size(); ++i) {
      if (!frame[i]) continue;
      const auto out = (frame[i]->array().abs() >= cut).count();
      remaining[i] += 2 * out > kPatternSize ? 0 : 1;
    }
  }
  report.t_scale = medianOf(scales);
  const int needed = std::min(options.min_observations, static_cast<int>(residuals.size()));
  Verdicts verdicts(remaining.size());
  std::transform(remaining.begin(), remaining.end(), verdicts.begin(), [needed](int count) {
    return static_cast<char>(count < needed ? 1 : 0);
  });
  return verdicts;
}

/// Drops corners, with their observations, and semi-dense points.
void removeFrom(InitialMap& map,
                const PhotometricProblem& problem,
                const Verdicts& verdicts,
                OutlierReport& report) {
  const std::size_t corners = map.corners.size();
  std::vector<char> gone(corners + map.points.size(), 0);
  for (std::size_t i = 0; i < verdicts.size(); ++i) gone[problem.source[i]] = verdicts[i];
  std::vector<int> new_index(corners, -1);
  std::size_t next = 0;
  for (std::size_t i = 0; i < corners; ++i) {
    if (gone[i] != 0) continue;
    new_index[i] = static_cast<int>(next);
    map.corners[next++] = map.corners[i];
  }
  map.corners.resize(next);
  std::size_t kept = 0;
  for (Observation observation : map.observations) {
    observation.corner = new_index[static_cast<std::size_t>(observation.corner)];
    if (observation.corner >= 0) map.observations[kept++] = observation;
  }
  map.observations.resize(kept);
  std::size_t point = 0;
  for (std::size_t i = 0; i < map.points.size(); ++i) {
    if (gone[corners + i] == 0) map.points[point++] = map.points[i];
  }
  report.examined = static_cast<int>(gone.size());
  report.removed_corners = static_cast<int>(corners - next);
  report.removed_points = static_cast<int>(map.points.size() - point);
  map.points.resize(point);
}

}  // namespace

OutlierReport removeOutliers(InitialMap& map,
                             const PinholeCamera& camera,
                             const PhotometricOptions& photometric,
                             const OutlierOptions& options) {
  OutlierReport report;
  const std::vector<std::size_t> frames = spreadFrames(map, photometric.max_frames);
  PhotometricProblem problem = makeProblem(map, camera, frames, 0, photometric.gradient_weights);
  const PhotometricState state = makeState(problem, map);
  std::vector<FrameResiduals> residuals;
  for (std::size_t f = 0; f < frames.size(); ++f) {
    residuals.push_back(residualsIn(problem, state, f, photometric.brightness));
  }
  removeFrom(map, problem, votePixels(problem, residuals, options, report), report);
  return report;
}

}  // namespace dsorb::init_orb
