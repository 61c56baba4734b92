// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/semi_dense/semi_dense_depth.h"

#include "base/parallel.h"
#include "base/random.h"
#include "image/pixel_selector.h"
#include "image/stuck_regions.h"
#include "init/orb/map/frame_brightness.h"
#include "init/orb/semi_dense/corner_prior.h"
#include "init/orb/semi_dense/epipolar_search.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace dsorb::init_orb {
namespace {

constexpr int kPatchSize = 6;  // one candidate in a square of this side [px]
/// Candidates that are searched: at least, and for each point that is wanted.
/// @source docs/experiments.md, "Epipolar search"
constexpr int kCandidates = 3000;
constexpr double kCandidatesAPoint = 1.5;
constexpr std::size_t kCandidateGrain = 64;  // candidates one thread takes at a time

std::size_t candidateCount(const SemiDenseOptions& options) {
  return static_cast<std::size_t>(
      std::max(kCandidates, static_cast<int>(kCandidatesAPoint * options.max_points)));
}

/// Grows the patches until few enough candidates are left; candidates that are still too many are
/// removed at random.
std::vector<SelectedPixel> selectCandidates(const Frame& reference,
                                            std::size_t most,
                                            Random& random) {
  RegionThresholds thresholds;
  thresholds.compute(reference);
  int patch_size = kPatchSize;
  std::vector<SelectedPixel> selected = selectPatchMaxima(reference, thresholds, patch_size);
  // The count is about proportional to 1 / patch_size^2.
  const double ratio = static_cast<double>(selected.size()) / static_cast<double>(most);
  const auto better_size = static_cast<int>(patch_size * std::sqrt(ratio));
  if (better_size > patch_size) {
    selected = selectPatchMaxima(reference, thresholds, better_size);
  }
  for (; selected.size() > most; selected.pop_back()) {
    std::swap(selected[random.below(static_cast<std::uint32_t>(selected.size()))], selected.back());
  }
  return selected;
}

/// Where the search for a candidate begins.
struct PointGuess {
  CornerPrior corners;
  const KnownDepths& known;
};

/// Result of one candidate; without observations it has no depth.
struct CandidateResult {
  SemiDensePoint point;
  int searches = 0;
  int matches = 0;
};

/// The inverse depth that a search starts from: what is known of it, with the width of a guess.
SemiDensePoint widened(const KnownInverseDepth& known, const Eigen::Vector2f& pixel) {
  const auto mean = static_cast<float>(known.mean);
  const float floor = kMinPriorSigma * mean;
  return {pixel, mean, std::max(static_cast<float>(known.variance), floor * floor)};
}

/// Weighs what is known with what was observed.
void addKnown(const KnownInverseDepth& known, SemiDensePoint& point) {
  point.known = known;
  const auto mean = static_cast<float>(known.mean);
  const auto variance = static_cast<float>(known.variance);
  if (point.observations == 0) {
    point.inverse_depth = mean;
    point.variance = variance;
  } else {
    const float sum = point.variance + variance;
    point.inverse_depth = (point.variance * mean + variance * point.inverse_depth) / sum;
    point.variance *= variance / sum;
  }
  ++point.observations;
}

CandidateResult observe(const SelectedPixel& pixel,
                        const PointGuess& guess,
                        const std::vector<EpipolarSearch>& frames,
                        const SemiDenseOptions& options,
                        EpipolarSearch::Scratch& scratch) {
  CandidateResult result;
  const Eigen::Vector2f at(static_cast<float>(pixel.x), static_cast<float>(pixel.y));
  const KnownInverseDepth known = guess.known ? guess.known(at) : KnownInverseDepth();
  CandidateDepth depth(known ? widened(known, at) : guess.corners.at(at), options.fusion);
  for (const EpipolarSearch& frame : frames) {
    const SearchOutcome outcome = frame.search(depth.current(), scratch);
    result.searches += outcome.status != SearchStatus::kSkipped ? 1 : 0;
    if (outcome.status == SearchStatus::kFound) {
      ++result.matches;
      depth.add(outcome.observation);
    }
  }
  if (!depth.removed()) {
    result.point = depth.current();
    result.point.observations = depth.observations();
    result.point.searches = result.searches;
    if (known) addKnown(known, result.point);
  }
  return result;
}

/// Every posed frame after the reference.
std::vector<SearchFrame> searchFrames(const InitialMap& map) {
  std::vector<SearchFrame> frames;
  for (std::size_t k = 1; k < map.frames.size(); ++k) {
    if (map.frames[k].T_cam_ref) {
      frames.push_back({map.frames[k].frame,
                        *map.frames[k].T_cam_ref,
                        map.frames[k].covariance.value_or(Matrix6d::Zero()),
                        brightnessTo(map, k),
                        shutterOf(map, k)});
    }
  }
  return frames;
}

}  // namespace

SemiDenseReport estimateSemiDenseDepth(InitialMap& map,
                                       const PinholeCamera& camera,
                                       const SemiDenseOptions& options,
                                       std::uint64_t seed,
                                       const KnownDepths& known) {
  SemiDenseReport report;
  map.points.clear();
  estimateBrightness(map, camera);
  const std::vector<SearchFrame> frames = searchFrames(map);
  if (map.corners.empty() || frames.empty()) {
    return report;
  }
  Random random(seed);
  const FramePtr& reference = map.frames.front().frame;
  std::vector<SelectedPixel> candidates =
      selectCandidates(*reference, candidateCount(options), random);
  StuckRegions(map.stuck, camera.width, camera.height).removeFrom(candidates);
  const PointGuess guess{{map.corners, camera.width, camera.height}, known};
  std::vector<EpipolarSearch> searches;
  searches.reserve(frames.size());
  for (const SearchFrame& frame : frames) {
    searches.emplace_back(reference, frame, camera, options, shutterOf(map, 0));
  }
  std::vector<CandidateResult> results(candidates.size());
  forEachRange(candidates.size(), kCandidateGrain, [&](std::size_t begin, std::size_t end) {
    EpipolarSearch::Scratch scratch;
    for (std::size_t i = begin; i < end; ++i) {
      results[i] = observe(candidates[i], guess, searches, options, scratch);
    }
  });
  for (const CandidateResult& result : results) {
    report.searched += result.searches > 0 ? 1 : 0;
    report.searches += result.searches;
    report.matches += result.matches;
    if (result.point.observations > 0) {
      map.points.push_back(result.point);
    }
  }
  report.candidates = static_cast<int>(candidates.size());
  report.points = static_cast<int>(map.points.size());
  return report;
}

void keepBestPoints(InitialMap& map, int wanted) {
  const auto total = static_cast<std::size_t>(wanted);
  const std::size_t left = total - std::min(total, map.corners.size());
  const std::size_t before = map.points.size();
  if (before <= left) return;
  std::vector<std::pair<float, std::size_t>> order;  // relative variance, point
  order.reserve(before);
  for (std::size_t i = 0; i < before; ++i) {
    const SemiDensePoint& point = map.points[i];
    order.emplace_back(point.variance / (point.inverse_depth * point.inverse_depth), i);
  }
  std::nth_element(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(left), order.end());
  std::vector<char> removed(before, 1);
  for (std::size_t k = 0; k < left; ++k) removed[order[k].second] = 0;
  eraseMarked(removed, map.points);
}

}  // namespace dsorb::init_orb
