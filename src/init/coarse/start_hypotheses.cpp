// SPDX-License-Identifier: BSD-3-Clause
#include "init/coarse/start_hypotheses.h"

#include "init/coarse/coarse_handover.h"

#include <algorithm>
#include <array>
#include <utility>

namespace dsorb::init_coarse {
namespace {

constexpr std::array<int, 5> kIterations = {5, 5, 10, 30, 50};  // per level, finest first
constexpr int kScreenIterations = 15;  // on the coarsest level, of every hypothesis
constexpr std::size_t kFinalists = 2;  // aligned on all levels
constexpr double kTranslation = 0.1;   // of a hypothesis, in units of the mean depth

double robustEnergy(const LevelReport& report) {
  const NormalEquations& sums = report.state.equations;
  return sums.good_energy + static_cast<double>(kOutlierEnergy) * (report.points - sums.good);
}

/// Motion along t with the rotation that keeps the plane of unit depth in place.
Alignment hypothesis(const Alignment& rotation, const Eigen::Vector3d& t) {
  Vector6d turn = Vector6d::Zero();
  turn[3] = t.y();
  turn[4] = -t.x();
  Alignment result = rotation;
  result.T_new_ref = SE3::exp(turn) * rotation.T_new_ref;
  result.T_new_ref.setTranslation(t);
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

/// All points good and on the plane of unit depth.
void restart(PointLevel& level) {
  flatten(level);
  std::fill(level.good.begin(), level.good.end(), std::uint8_t{1});
}

}  // namespace

double Estimate::energy() const {
  return robustEnergy(finest);
}

void alignLevels(const AlignmentTask& task, Estimate& estimate) {
  std::vector<PointLevel>& levels = estimate.levels;
  Alignment& alignment = estimate.alignment;
  const int top = static_cast<int>(levels.size()) - 1;
  for (int l = top; l >= 0; --l) {
    PointLevel& points = levels[static_cast<std::size_t>(l)];
    if (l < top) {
      propagateDown(levels[static_cast<std::size_t>(l + 1)], points);
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
  for (int l = 0; l < top; ++l) {
    PointLevel& coarse = levels[static_cast<std::size_t>(l + 1)];
    propagateUp(levels[static_cast<std::size_t>(l)], task.options.keep_orphan_depth, coarse);
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
  std::optional<Estimate> best;
  double least = given.energy();
  for (std::size_t i = 0; i < std::min(kFinalists, screened.size()); ++i) {
    Estimate trial{given.levels, screened[i].second, {}};
    for (PointLevel& level : trial.levels) restart(level);
    alignLevels(task, trial);
    if (trial.energy() < least) {
      least = trial.energy();
      best = std::move(trial);
    }
  }
  return best;
}

}  // namespace dsorb::init_coarse
