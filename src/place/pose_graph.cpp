// SPDX-License-Identifier: BSD-3-Clause
#include "place/pose_graph.h"

#include <Eigen/Cholesky>
#include <ceres/ceres.h>
#include <ceres/rotation.h>

#include <array>

namespace dsorb::place {
namespace {

constexpr int kMaxIterations = 50;
constexpr double kCauchy = 3;  // standard deviations of an edge

/// A similarity over any scalar.
template <typename T>
struct SimilarityOf {
  Eigen::Quaternion<T> rotation;
  Eigen::Matrix<T, 3, 1> translation;
  T scale;

  explicit SimilarityOf(const Similarity& s)
      : rotation(s.motion.unitQuaternion().cast<T>()),
        translation(s.motion.translation().cast<T>()),
        scale(T(s.scale)) {}
  /// @param increment [translation; rotation; log of the scale]
  explicit SimilarityOf(const T* increment)
      : translation(increment[0], increment[1], increment[2]), scale(exp(increment[6])) {
    T q[4];  // NOLINT(modernize-avoid-c-arrays): w x y z, as Ceres has it
    ceres::AngleAxisToQuaternion(increment + 3, q);
    rotation = Eigen::Quaternion<T>(q[0], q[1], q[2], q[3]);
  }
  SimilarityOf(const Eigen::Quaternion<T>& r, const Eigen::Matrix<T, 3, 1>& t, const T& s)
      : rotation(r), translation(t), scale(s) {}
  SimilarityOf operator*(const SimilarityOf& o) const {
    return {
        rotation * o.rotation, translation + scale * (rotation * o.translation), scale * o.scale};
  }
  [[nodiscard]] SimilarityOf inverse() const {
    const Eigen::Quaternion<T> back = rotation.conjugate();
    return {back, -(back * translation) / scale, T(1) / scale};
  }
};

/// Error of an edge over its standard deviations. Unknowns are left increments of the cameras.
struct EdgeError {
  Similarity start_i;
  Similarity start_j;
  Similarity S_j_i;
  Eigen::Matrix<double, 7, 7> root_information;

  template <typename T>
  bool operator()(const T* const i, const T* const j, T* residual) const {
    const SimilarityOf<T> cam_i = SimilarityOf<T>(i) * SimilarityOf<T>(start_i);
    const SimilarityOf<T> cam_j = SimilarityOf<T>(j) * SimilarityOf<T>(start_j);
    const SimilarityOf<T> error = cam_i.inverse() * cam_j * SimilarityOf<T>(S_j_i);
    const T q[4] = {error.rotation.w(), error.rotation.x(), error.rotation.y(), error.rotation.z()};
    T turned[3];
    ceres::QuaternionToAngleAxis(q, turned);
    Eigen::Matrix<T, 7, 1> xi;
    xi << error.translation, turned[0], turned[1], turned[2], log(error.scale);
    Eigen::Map<Eigen::Matrix<T, 7, 1>> weighted(residual);
    weighted = root_information.cast<T>() * xi;
    return true;
  }
};

}  // namespace

std::vector<Similarity> adjustGraph(const std::vector<Similarity>& S_world_cam,
                                    const std::vector<GraphEdge>& edges,
                                    int num_threads) {
  std::vector<std::array<double, 7>> increments(S_world_cam.size(), std::array<double, 7>{});
  ceres::Problem problem;
  for (auto& increment : increments) problem.AddParameterBlock(increment.data(), 7);
  problem.SetParameterBlockConstant(increments.front().data());
  for (const GraphEdge& edge : edges) {
    const Eigen::Matrix<double, 7, 7> information =
        Eigen::Matrix<double, 7, 7>(edge.covariance).inverse();
    const Eigen::Matrix<double, 7, 7> root = information.llt().matrixU();
    problem.AddResidualBlock(
        new ceres::AutoDiffCostFunction<EdgeError, 7, 7, 7>(
            new EdgeError{S_world_cam[edge.i], S_world_cam[edge.j], edge.S_i_j.inverse(), root}),
        edge.doubtful ? new ceres::CauchyLoss(kCauchy) : nullptr,
        increments[edge.i].data(),
        increments[edge.j].data());
  }
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
  options.max_num_iterations = kMaxIterations;
  options.num_threads = num_threads;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  std::vector<Similarity> adjusted = S_world_cam;
  if (!summary.IsSolutionUsable()) return adjusted;
  for (std::size_t k = 0; k < adjusted.size(); ++k) {
    adjusted[k] = Similarity::increment(Vector7d(increments[k].data())) * adjusted[k];
  }
  return adjusted;
}

}  // namespace dsorb::place
