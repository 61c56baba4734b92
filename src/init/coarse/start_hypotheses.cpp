// SPDX-License-Identifier: BSD-3-Clause
#include "init/coarse/start_hypotheses.h"

#include "base/parallel.h"
#include "init/coarse/coarse_handover.h"

#include <algorithm>
#include <array>
#include <cstdlib>
#include <utility>

namespace dsorb::init_coarse {
namespace {

constexpr std::array<int, 5> kIterations = {5, 5, 10, 30, 50};  // per level, finest first
constexpr int kScreenIterations = 15;  // on the coarsest level, of every hypothesis
constexpr std::size_t kFinalists = 2;  // aligned on all levels
constexpr double kTranslation = 0.1;   // of a hypothesis, in units of the mean depth
constexpr std::size_t kRivals = 3;     // of an estimate, aligned on all levels
constexpr double kConverged = 0.98;    // of the energy left by a pass: the next one would not help
// Passes after the first one took away up to 0.27 of its energy, those after the second one no more
// each than it did (20 contests on five sequences; one estimate of 80 did better, and lost).
constexpr double kMaxLaterGain = 0.35;
constexpr double kSameDirection = 0.94;  // cosine of 20 deg

double robustEnergy(const LevelReport& report) {
  return report.state.sums.robustEnergy(report.points);
}

/// Motion along t with the rotation that keeps the plane of unit depth in place.
Alignment hypothesis(const Alignment& rotation, const Eigen::Vector3d& t) {
  Vector6d turn = Vector6d::Zero();
  turn[3] = t.y();
  turn[4] = -t.x();
  Alignment result = rotation;
  result.T_cur_ref = SE3::exp(turn) * rotation.T_cur_ref;
  result.T_cur_ref.setTranslation(t);
  result.snapped = true;
  return result;
}

std::vector<Alignment> hypotheses(const Alignment& rotation) {
  std::vector<Alignment> result;
  for (int axis = 0; axis < 3; ++axis) {
    for (const double sign : {-1.0, 1.0}) {
      result.push_back(hypothesis(rotation, sign * kTranslation * Eigen::Vector3d::Unit(axis)));
    }
  }
  return result;
}

/// Mean inverse depth of the good points.
float meanInverseDepth(const PointLevel& points) {
  double sum = 0;
  int count = 0;
  for (std::size_t i = 0; i < points.x.size(); ++i) {
    if (points.good[i] == 0) continue;
    sum += static_cast<double>(points.smoothed[i]);
    ++count;
  }
  return count > 0 ? static_cast<float>(sum / count) : 1.0F;
}

/// The axes and the diagonals between them, both ways.
std::vector<Eigen::Vector3d> directions() {
  std::vector<Eigen::Vector3d> result;
  for (int x = -1; x <= 1; ++x) {
    for (int y = -1; y <= 1; ++y) {
      for (int z = -1; z <= 1; ++z) {
        const int parts = std::abs(x) + std::abs(y) + std::abs(z);
        if (parts == 1 || parts == 3) result.push_back(Eigen::Vector3d(x, y, z).normalized());
      }
    }
  }
  return result;
}

bool sameDirection(const Alignment& a, const Alignment& b) {
  const Eigen::Vector3d t_a = a.T_cur_ref.translation().normalized();
  return t_a.dot(b.T_cur_ref.translation().normalized()) > kSameDirection;
}

/// All points good and on the plane of unit depth.
void restart(PointLevel& level) {
  flatten(level);
  std::fill(level.good.begin(), level.good.end(), std::uint8_t{1});
}

void sortByEnergy(std::vector<Estimate>& estimates) {
  std::stable_sort(estimates.begin(), estimates.end(), [](const Estimate& a, const Estimate& b) {
    return a.energy() < b.energy();
  });
}

/// Calls function(task, estimate) for all estimates from one on, at the same time where threads are
/// free; each task has an aligner, which holds buffers, of its own.
template <typename Function>
void forEachOf(std::vector<Estimate>& estimates,
               std::size_t first,
               const AlignmentTask& task,
               const Function& function) {
  forEachRange(estimates.size() - first, 1, [&](std::size_t begin, std::size_t end) {
    LevelAligner aligner(task.options);
    const AlignmentTask own{task.frame, task.camera, task.options, aligner};
    for (std::size_t i = first + begin; i < first + end; ++i) function(own, estimates[i]);
  });
}

/// Levels from `finest` on; the finer ones stay empty.
std::vector<PointLevel> coarseLevels(const std::vector<PointLevel>& levels, std::size_t finest) {
  std::vector<PointLevel> coarse(levels.size());
  std::copy(levels.begin() + static_cast<std::ptrdiff_t>(finest),
            levels.end(),
            coarse.begin() + static_cast<std::ptrdiff_t>(finest));
  return coarse;
}

/// Gives back what coarseLevels() left out, on the plane of unit depth.
void addFineLevels(const std::vector<PointLevel>& all, std::vector<PointLevel>& levels) {
  for (std::size_t l = 0; l < levels.size() && levels[l].x.empty(); ++l) {
    levels[l] = all[l];
    restart(levels[l]);
  }
}

/// Estimates from the plane of unit depth, of the coarse levels alone, the best first.
std::vector<Estimate> screenDirections(const AlignmentTask& task,
                                       const Alignment& rotation,
                                       const Estimate& given) {
  const int finest = std::max(static_cast<int>(given.levels.size()) - 2, 0);
  const double length = given.alignment.T_cur_ref.translation().norm() *
                        static_cast<double>(meanInverseDepth(given.levels.front()));
  std::vector<Estimate> screened;
  for (const Eigen::Vector3d& direction : directions()) {
    screened.push_back({coarseLevels(given.levels, static_cast<std::size_t>(finest)),
                        hypothesis(rotation, length * direction),
                        {}});
    for (PointLevel& level : screened.back().levels) restart(level);
  }
  forEachOf(screened, 0, task, [finest](const AlignmentTask& own, Estimate& trial) {
    alignLevels(own, finest, trial);
  });
  sortByEnergy(screened);
  return screened;
}

constexpr int kRotationIterations = 10;
constexpr double kMinMatchShare = 0.8;  // of the points in view, else the grid is searched
constexpr double kGridStep = 1.5;       // [px of the coarsest level], within the alignment's reach
constexpr int kGridRadius = 3;          // steps: 72 px of level 0 with five levels

std::vector<Alignment> gridAround(const Alignment& center, const PinholeCamera& camera) {
  std::vector<Alignment> grid;
  for (int i = -kGridRadius; i <= kGridRadius; ++i) {
    for (int j = -kGridRadius; j <= kGridRadius; ++j) {
      Vector6d turn = Vector6d::Zero();
      turn[3] = kGridStep * i / camera.fy;
      turn[4] = kGridStep * j / camera.fx;
      grid.push_back(center);
      grid.back().T_cur_ref = SE3::exp(turn) * center.T_cur_ref;
    }
  }
  return grid;
}

}  // namespace

double Estimate::energy() const {
  return robustEnergy(finest);
}

void alignLevels(const AlignmentTask& task, int finest, Estimate& estimate) {
  std::vector<PointLevel>& levels = estimate.levels;
  Alignment& alignment = estimate.alignment;
  const int top = static_cast<int>(levels.size()) - 1;
  for (int l = top; l >= finest; --l) {
    PointLevel& points = levels[static_cast<std::size_t>(l)];
    if (l < top) {
      propagateDown(levels[static_cast<std::size_t>(l) + 1], points);
      regularize(alignment.snapped, points);
    } else {
      reviveFromNeighbours(points);
    }
    points.trial_inverse_depth = points.inverse_depth;
    estimate.finest = task.aligner.align(viewOf(task.frame, task.camera, l),
                                         kIterations[static_cast<std::size_t>(l)],
                                         Unknowns::kAll,
                                         points,
                                         alignment);
  }
  for (int l = finest; l < top; ++l) {
    PointLevel& coarse = levels[static_cast<std::size_t>(l) + 1];
    propagateUp(levels[static_cast<std::size_t>(l)], !task.options.published, coarse);
    regularize(alignment.snapped, coarse);
  }
}

std::optional<Estimate> betterHypothesis(const AlignmentTask& task,
                                         const Alignment& rotation,
                                         const Estimate& given) {
  const int top = static_cast<int>(given.levels.size()) - 1;
  const LevelView coarsest = viewOf(task.frame, task.camera, top);
  std::vector<std::pair<double, Alignment>> screened;
  for (const Alignment& start : hypotheses(rotation)) {
    PointLevel points = given.levels.back();
    restart(points);
    Alignment alignment = start;
    const LevelReport report =
        task.aligner.align(coarsest, kScreenIterations, Unknowns::kAll, points, alignment);
    screened.emplace_back(robustEnergy(report), start);
  }
  std::stable_sort(screened.begin(), screened.end(), [](const auto& a, const auto& b) {
    return a.first < b.first;
  });
  std::vector<Estimate> finalists;
  for (std::size_t i = 0; i < std::min(kFinalists, screened.size()); ++i) {
    finalists.push_back({given.levels, screened[i].second, {}});
    for (PointLevel& level : finalists.back().levels) restart(level);
  }
  forEachOf(finalists, 0, task, [](const AlignmentTask& own, Estimate& trial) {
    alignLevels(own, 0, trial);
  });
  sortByEnergy(finalists);
  if (finalists.empty() || !(finalists.front().energy() < given.energy())) return std::nullopt;
  return std::move(finalists.front());
}

void converge(const AlignmentTask& task, const Aim& aim, Estimate& estimate) {
  double before = HUGE_VAL;
  for (int left = task.options.max_passes - 1; left >= 0; --left) {
    alignLevels(task, 0, estimate);
    const double energy = estimate.energy();
    if (estimate.finest.inlierShare() * estimate.finest.visibleShare() > aim.enough) break;
    if (energy > kConverged * before) break;
    const double possible_gain = std::min(left * (before - energy), kMaxLaterGain * energy);
    if (energy - possible_gain > aim.energy) break;
    before = energy;
  }
}

Contest contest(const AlignmentTask& task, const Alignment& rotation, const Estimate& given) {
  std::vector<Estimate> finalists = {given};
  for (Estimate& trial : screenDirections(task, rotation, given)) {
    const bool known = std::any_of(finalists.begin(), finalists.end(), [&](const Estimate& other) {
      return sameDirection(other.alignment, trial.alignment);
    });
    if (known) continue;
    addFineLevels(given.levels, trial.levels);
    finalists.push_back(std::move(trial));
    if (finalists.size() > kRivals) break;
  }
  converge(task, {}, finalists.front());
  Aim aim;
  aim.energy = (1.0 + task.options.min_rival_margin) * finalists.front().energy();
  forEachOf(finalists, 1, task, [&aim](const AlignmentTask& own, Estimate& finalist) {
    converge(own, aim, finalist);
  });
  sortByEnergy(finalists);
  const auto rival = std::find_if(finalists.begin(), finalists.end(), [&](const Estimate& other) {
    return !sameDirection(finalists.front().alignment, other.alignment);
  });
  const double margin =
      rival == finalists.end() ? HUGE_VAL : rival->energy() / finalists.front().energy() - 1.0;
  return {std::move(finalists.front()), margin};
}

double RotationSearch::energy(const LevelView& view, const Alignment& alignment) {
  std::fill(points_.good.begin(), points_.good.end(), std::uint8_t{1});
  return aligner_.evaluate(view, Unknowns::kRotation, points_, alignment)
      .sums.robustEnergy(points_.size());
}

Alignment RotationSearch::best(const LevelView& view, const std::vector<Alignment>& candidates) {
  double least = HUGE_VAL;
  Alignment result = candidates.front();
  for (const Alignment& candidate : candidates) {
    const double value = energy(view, candidate);
    if (value < least) {
      least = value;
      result = candidate;
    }
  }
  return result;
}

double RotationSearch::refine(const LevelView& view, Alignment& alignment) {
  std::fill(points_.good.begin(), points_.good.end(), std::uint8_t{1});
  return aligner_.align(view, kRotationIterations, Unknowns::kRotation, points_, alignment)
      .inlierShare();
}

RotationMatch RotationSearch::find(const LevelView& coarsest,
                                   const std::vector<Alignment>& starts) {
  std::vector<Alignment> candidates = starts;
  for (Alignment& candidate : candidates) {
    candidate.T_cur_ref.setTranslation(Eigen::Vector3d::Zero());
    candidate.snapped = false;
  }
  const Alignment start = best(coarsest, candidates);
  Alignment near = start;
  if (refine(coarsest, near) >= kMinMatchShare) return {near, true};
  Alignment far = best(coarsest, gridAround(start, coarsest.camera));
  const bool matches = refine(coarsest, far) >= kMinMatchShare;
  return matches ? RotationMatch{far, true} : RotationMatch{best(coarsest, {near, far}), false};
}

}  // namespace dsorb::init_coarse
