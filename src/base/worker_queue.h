// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <condition_variable>
#include <cstddef>
#include <deque>
#include <exception>
#include <functional>
#include <mutex>
#include <optional>
#include <thread>
#include <utility>

namespace dsorb {

/// Works on jobs in the order given, at once or in a thread of its own. One thread gives jobs and
/// takes results. What the work reads and writes belongs to the queue while it is busy.
template <typename Job, typename Result>
class WorkerQueue {
 public:
  /// @param max_waiting jobs that wait at most while one is worked on; 0: no thread, work is done
  ///                    in submit()
  WorkerQueue(std::function<Result(const Job&)> work, int max_waiting)
      : work_(std::move(work)),
        max_waiting_(max_waiting > 0 ? static_cast<std::size_t>(max_waiting) : 0) {
    if (max_waiting_ > 0) worker_ = std::thread([this] { run(); });
  }
  /// Drops the jobs that wait and ends when the current job is done.
  ~WorkerQueue() {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      stopped_ = true;
      jobs_.clear();
    }
    changed_.notify_all();
    if (worker_.joinable()) worker_.join();
  }
  WorkerQueue(const WorkerQueue&) = delete;
  WorkerQueue& operator=(const WorkerQueue&) = delete;

  /// Waits while the queue is full. After a job has thrown, jobs are dropped until its exception is
  /// taken.
  void submit(Job job) {
    if (max_waiting_ == 0) {
      if (!error_) work(job);
      return;
    }
    std::unique_lock<std::mutex> lock(mutex_);
    changed_.wait(lock, [this] { return jobs_.size() < max_waiting_ || error_; });
    if (!error_) jobs_.push_back(std::move(job));
    lock.unlock();
    changed_.notify_all();
  }

  /// @return the oldest result not yet taken, empty when there is none at the moment
  /// @throws what a job threw, once all results before it are taken
  [[nodiscard]] std::optional<Result> take() {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (results_.empty()) {
      if (error_) std::rethrow_exception(std::exchange(error_, nullptr));
      return std::nullopt;
    }
    std::optional<Result> result = std::move(results_.front());
    results_.pop_front();
    return result;
  }

  /// Whether a job is left to do or a result to take.
  [[nodiscard]] bool busy() const {
    const std::lock_guard<std::mutex> lock(mutex_);
    return is_working_ || !jobs_.empty() || !results_.empty() || error_;
  }

  /// Waits until all work is done.
  void wait() {
    std::unique_lock<std::mutex> lock(mutex_);
    changed_.wait(lock, [this] { return !is_working_ && jobs_.empty(); });
  }

  /// Drops the jobs that wait, waits for the current one, and drops all results.
  void discard() {
    std::unique_lock<std::mutex> lock(mutex_);
    jobs_.clear();
    changed_.wait(lock, [this] { return !is_working_; });
    results_.clear();
    error_ = nullptr;
  }

 private:
  void run() {
    std::unique_lock<std::mutex> lock(mutex_);
    while (true) {
      changed_.wait(lock, [this] { return stopped_ || !jobs_.empty(); });
      if (stopped_) return;
      const Job job = std::move(jobs_.front());
      jobs_.pop_front();
      is_working_ = true;
      lock.unlock();
      changed_.notify_all();
      work(job);
      lock.lock();
      is_working_ = false;
      changed_.notify_all();
    }
  }

  /// Leaves the result, or the exception, to take().
  void work(const Job& job) {
    std::optional<Result> result;
    std::exception_ptr error;
    try {
      result = work_(job);
    } catch (...) {
      error = std::current_exception();
    }
    const std::lock_guard<std::mutex> lock(mutex_);
    if (result) results_.push_back(std::move(*result));
    if (error) {
      error_ = error;
      jobs_.clear();
    }
  }

  const std::function<Result(const Job&)> work_;
  const std::size_t max_waiting_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<Job> jobs_;
  std::deque<Result> results_;
  std::exception_ptr error_;
  bool is_working_ = false;
  bool stopped_ = false;
  std::thread worker_;
};

}  // namespace dsorb
